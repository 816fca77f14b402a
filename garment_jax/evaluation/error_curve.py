"""The error over time as a picture."""

from pathlib import Path

import matplotlib
import numpy as np

from garment_jax.evaluation.drawn_by import WRITER
from garment_jax.storage.whole import written_whole


def save_error_curve(
    path: Path, rmse_cm: np.ndarray, largest_cm: np.ndarray, *, fps: float, title: str
) -> None:
    """Plot per-frame RMSE and largest vertex distance `[t]`, both in cm, over seconds; write a PNG."""
    matplotlib.use("Agg")  # headless: never look for a display
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3), dpi=120, layout="constrained")
    axes = figure.subplots()
    seconds = np.arange(len(rmse_cm)) / fps
    clip = float(np.sqrt((rmse_cm**2).mean()))
    axes.fill_between(seconds, largest_cm, color="#cc5c3d", alpha=0.16, lw=0, label="largest vertex distance")
    axes.plot(seconds, rmse_cm, color="#cc5c3d", lw=1.6, label="RMSE of the frame")
    axes.axhline(clip, color="#3b6b9e", lw=1.2, ls="--", label=f"RMSE of the clip, {clip:.2f} cm")
    axes.set(xlabel="time, s", ylabel="error, cm", title=title, xlim=(0, max(seconds[-1], 1 / fps)))
    axes.set_ylim(bottom=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper right", ncols=3, fontsize=8)
    with written_whole(path) as (made,):
        figure.savefig(made, format="png", metadata={"Software": WRITER})
