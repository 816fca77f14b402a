"""The motions of virtual bones in every training frame, once per data set."""

import os

import numpy as np

from garment_jax.baselines.bones import Bones, as_numbers, bone_transforms
from garment_jax.data.prepared import PreparedClip, frames_of
from garment_jax.training.run import Run, say

CHUNK = 256  # frames in memory at a time


def bone_targets(run: Run, bones: Bones) -> list[np.ndarray]:
    """Return each training clip's bone motions `[t, b, 6]` (radians, metres); cached in the run's folder."""
    path = run.folder / "cache" / f"bone-motions-{bones.weights.shape[1]}-{run.data.content}.npz"
    if not path.exists():
        say("bones: their motion in every training frame")
        motions = {str(i): _of_clip(run, clip, bones) for i, clip in enumerate(run.data.train)}
        partial = path.with_suffix(".partial.npz")
        np.savez(partial, **motions)  # type: ignore[arg-type]
        os.replace(partial, path)
    with np.load(path) as stored:
        return [stored[str(i)] for i in range(len(run.data.train))]


def _of_clip(run: Run, clip: PreparedClip, bones: Bones) -> np.ndarray:
    parts = []
    for start in range(0, len(clip.V), CHUNK):
        V = frames_of(clip, np.arange(start, min(start + CHUNK, len(clip.V))), run.data)
        parts.append(as_numbers(*bone_transforms(run.template.T, V, bones.weights), bones.centres))
    return np.concatenate(parts)
