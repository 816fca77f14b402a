"""What a baseline reads of the clips beside the prepared data: their whole motions, and errors on them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.body.mirror import mirror_motion
from garment_jax.data.prepared import DataSet, PreparedClip, training_clips
from garment_jax.data.sequence import open_sequence
from garment_jax.structs import Motion


def clip_motions(data: DataSet, clips: Sequence[PreparedClip], data_dir: str | Path) -> list[Motion]:
    """Return the motion of each of `clips`, which are of `data_dir`; mirror images mirrored."""
    recorded = {}
    for path in training_clips(data_dir, ()):
        with open_sequence(path) as sequence:
            recorded[sequence.name] = sequence.motion
    out = []
    for clip in clips:
        motion = recorded[clip.name.removesuffix(" mirrored") if clip.mirrored else clip.name]
        out.append(mirror_motion(motion, data.scene.body) if clip.mirrored else motion)
    return out


def clip_errors(clips: Sequence[PreparedClip], V: Sequence[np.ndarray]) -> dict[str, float]:
    """Return the RMSE of `V` `[t, n, 3]` on each of `clips` and their mean, cm, by name; root frames."""
    square = [1e4 * np.square(v - c.V).sum(axis=-1).mean() for v, c in zip(V, clips, strict=True)]
    errors = {f"{c.name}_rmse_cm": float(np.sqrt(s)) for c, s in zip(clips, square, strict=True)}
    return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}
