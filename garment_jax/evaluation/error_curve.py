"""The error over time as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from garment_jax.evaluation.determined import PARTED_CM, determined_frames
from garment_jax.evaluation.drawn_by import WRITER
from garment_jax.storage.whole import written_whole


def save_error_curve(
    path: Path, rmse_cm: np.ndarray, largest_cm: np.ndarray, *, fps: float, title: str, first: int = 0
) -> None:
    """Plot RMSE and largest vertex distance `[t]`, cm, of frames from `first` on over seconds, as a PNG."""
    figure = Figure(figsize=(9, 3), dpi=120, layout="constrained")
    axes = figure.subplots()
    seconds = (first + np.arange(len(rmse_cm))) / fps
    clip = float(np.sqrt((rmse_cm**2).mean()))
    axes.fill_between(seconds, largest_cm, color="#cc5c3d", alpha=0.16, lw=0, label="largest vertex distance")
    axes.plot(seconds, rmse_cm, color="#cc5c3d", lw=1.6, label="RMSE of the frame")
    axes.axhline(clip, color="#3b6b9e", lw=1.2, ls="--", label=f"RMSE of the clip, {clip:.2f} cm")
    axes.set(
        xlabel="time, s",
        ylabel="error, cm",
        title=title,
        xlim=(seconds[0], seconds[0] + max(np.ptp(seconds), 1 / fps)),
    )
    axes.set_ylim(bottom=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper right", ncols=3, fontsize=8)
    figure.savefig(path, format="png", metadata={"Software": WRITER})


def save_curves(path: Path, clips: Sequence[Mapping[str, Any]]) -> None:
    """Plot the error of every clip over seconds, one below the other; write a PNG.

    `clips` are figures of `evaluate_files`. Where they have a second simulation (S), its distance from the
    first is drawn as well, and the frames that it determines are shaded.
    """
    figure = Figure(figsize=(9, 0.6 + 1.5 * len(clips)), dpi=120, layout="constrained")
    rows = figure.subplots(len(clips), 1, squeeze=False, sharey=True)[:, 0]
    for axes, clip in zip(rows, clips, strict=True):
        curves = {name: np.asarray(values) for name, values in clip["per_frame"].items()}
        seconds = np.arange(clip["frames"]) / clip["fps"]
        axes.plot(seconds, curves["rmse_cm"], color="#cc5c3d", lw=1.4, label="error of the prediction")
        again = curves.get("again_rmse_cm")
        if again is not None:
            axes.plot(seconds, again, color="#3b6b9e", lw=1.4, label="second simulation (S)")
            axes.axhline(PARTED_CM, color="#3b6b9e", lw=0.8, ls=":")
            until = determined_frames(again) / clip["fps"]
            axes.axvspan(0, until, color="#3b6b9e", alpha=0.08, lw=0, label="determined frames")
        axes.set(ylabel="RMSE, cm", xlim=(0, max(seconds[-1], 1 / clip["fps"])))
        axes.set_title(clip["clip"], loc="left", fontsize=9)
        axes.spines[["top", "right"]].set_visible(False)
    rows[0].set_ylim(bottom=0)
    rows[-1].set_xlabel("time, s")
    handles, labels = rows[0].get_legend_handles_labels()
    figure.legend(handles, labels, frameon=False, loc="outside upper right", ncols=3, fontsize=8)
    with written_whole(path) as (made,):
        figure.savefig(made, format="png", metadata={"Software": WRITER})
