"""The motions of virtual bones in every training frame, once per data set."""

import numpy as np

from garment_jax.baselines.bones import Bones, as_numbers, bone_transforms
from garment_jax.dataset.cached_arrays import cached_list
from garment_jax.dataset.prepared import PreparedClip, frames_of
from garment_jax.training.run import Run, say

CHUNK = 256  # frames in memory at a time


def bone_targets(run: Run, bones: Bones) -> list[np.ndarray]:
    """Return each training clip's bone motions `[t, b, 6]` (radians, metres); cached in the run's folder."""
    path = run.folder / "cache" / f"bone-motions-{bones.weights.shape[1]}-{run.data.content}.npz"

    def motions() -> list[np.ndarray]:
        say("bones: their motion in every training frame")
        return [_of_clip(run, clip, bones) for clip in run.data.train]

    return cached_list(path, motions, [len(clip.V) for clip in run.data.train])


def _of_clip(run: Run, clip: PreparedClip, bones: Bones) -> np.ndarray:
    parts = []
    for start in range(0, len(clip.V), CHUNK):
        V = frames_of(clip, np.arange(start, min(start + CHUNK, len(clip.V))), run.data)
        parts.append(as_numbers(*bone_transforms(run.template.T, V, bones.weights), bones.centres))
    return np.concatenate(parts)
