"""The model on motions kept back: animated, compared with their simulation, shown."""

import datetime
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.animation.animate import Animator, animate_file
from garment_jax.aot_cache import warm_start
from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation.command import evaluate_files
from garment_jax.evaluation.portrait import frame_portrait
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine
from garment_jax.model.folder import PICTURE
from garment_jax.model.store import load_model
from garment_jax.progress import FrameProgress
from garment_jax.storage.whole import written_whole
from garment_jax.viewer.command import view_files

FIGURES = "figures.json"
EVERY = 10  # frames between two of which penetration is measured
# as in models/skirt/figures.json
_KEPT = (
    "rmse_cm", "mean_distance_cm", "hausdorff_cm", "sted", "drift_ratio", "inside_percent", "deepest_mm",
    "pierced_percent", "truth_pierced_percent", "hem_height_difference_cm", "hem_motion_std_ratio",
    "laplacian_power_ratio", "strain_mean_percent", "skinned_template_rmse_cm",
)  # fmt: skip


def measure(
    folder: Path, clips: Sequence[Path], work: Path, *, command: str, trained_on: str
) -> tuple[dict[str, Any], list[Path]]:
    """Animate `clips` with the model in `folder`, write its figures and picture, return figures and pages.

    Predictions and pages, prediction beside simulation, go into `work`. `command` and `trained_on` are for
    `figures.json`.
    """
    model, store = load_model(folder), warm_start().store
    animators: dict[tuple, Animator] = {}
    rows: dict[str, dict[str, float | None]] = {}
    pages = []
    predicted = work / "predicted"
    predicted.mkdir(exist_ok=True)
    for clip in clips:
        made = predicted / clip.name
        animate_file(model, clip, made, store=store, animators=animators)
        with FrameProgress(f"measuring {clip.stem}") as progress:
            found = evaluate_files(made, clip, every=EVERY, arms=False, progress=progress)
        rows[clip.stem] = {name: _rounded(found["metrics"].get(name)) for name in _KEPT}
        page = work / f"{clip.stem}.html"
        view_files([made, clip], page, truth=clip, title=f"{folder.name}: {clip.stem}", force=True)
        pages.append(page)
    figures = {
        "command": command,
        "date": datetime.date.today().isoformat(),
        "machine": f"{machine()['processor']}, {machine()['cores']} cores",
        "trained_on": trained_on,
        "ms_per_frame": round(_milliseconds(next(iter(animators.values())), clips[0]), 2),
        "clips": rows,
    }
    with written_whole(folder / FIGURES) as (temporary,):
        temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    with written_whole(folder / PICTURE) as (temporary,):
        temporary.write_bytes(lively(predicted / clips[0].name))
    return figures, pages


def _milliseconds(run: Animator, path: Path) -> float:
    """Return the median of a chunk's milliseconds a frame, of one motion at a time, all parts included."""
    with open_sequence(path) as clip:
        motion = clip.motion
    ends, frames = [time.perf_counter()], []
    for piece in run(motion, name=path.stem):
        ends.append(time.perf_counter())
        frames.append(len(piece.V))
    each = 1e3 * np.diff(ends) / frames
    return float(np.median(each[1:] if len(each) > 1 else each))  # the first also fills the threads


def lively(path: Path) -> bytes:
    """Return a PNG of a frame in which the garment hangs less as at rest than in three quarters of them.

    The extreme one would show what happens once in a clip.
    """
    with open_sequence(path) as clip:
        which = np.unique(np.linspace(0, clip.frames - 1, 20).astype(int))
        garments = np.stack([clip.read(int(f), int(f) + 1)[0] for f in which])
        yaw = heading(clip.motion.rotations[which, 0])
        hanging = to_root(garments.astype(np.float64), clip.motion.root[which], yaw)
        rest = clip.scene.garment.template - clip.scene.body.joints[0]
        k = int(np.linalg.norm(hanging - rest[None], axis=2).mean(axis=1).argsort()[(3 * len(which)) // 4])
        return frame_portrait(clip.scene, clip.motion, int(which[k]), garments[k])


def mean_of(figures: Mapping[str, Any], name: str) -> float:
    """Return the mean of a figure over the clips."""
    return float(np.mean([row[name] for row in figures["clips"].values()]))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 4)
