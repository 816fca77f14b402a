"""A garment's motion as a mirror shows it: left and right change places (host).

Cloth knows no left: what a skirt does in a dance it does mirrored in the mirrored dance, as far as garment
and body are alike on both sides. So every clip teaches twice.
"""

import numpy as np

from garment_jax.swing.motion import FEATURES, SwingFrame
from garment_jax.swing.tables import LEVELS, SwingTables

ALIKE = 0.25  # root mean square of what differs, in what counts as 1, up to which a garment is symmetric
AROUND = np.array([1.0, -1.0, 1.0], np.float32)  # outward, around the body, up
SEEN = np.concatenate([np.tile(AROUND, 3), np.ones(2 * LEVELS, np.float32)])
ROOT = np.array([-1.0, 1.0, 1.0], np.float32)  # +X is the body's left

assert len(SEEN) == FEATURES


def mirrored_cells(X: np.ndarray) -> np.ndarray:
    """Return cells `[..., a, h, 3]`, metres in the columns' frames, mirrored in the plane x = 0."""
    return X[..., _places(X.shape[-3]), :, :] * AROUND


def mirrored_frames(frames: SwingFrame) -> SwingFrame:
    """Return frames (leaves `[..., a, .]`) as they are of the mirrored motion."""
    order = _places(frames.seen.shape[-2])
    return SwingFrame(
        frames.seen[..., order, :] * SEEN,
        frames.way[..., order, :] * AROUND,
        -frames.turn,
        frames.anchor[..., order, :] * ROOT,
    )


def is_symmetric(tables: SwingTables) -> bool:
    """Return whether the garment hangs alike on both sides of the body, cell by cell, but for `ALIKE`."""
    order = _places(len(tables.filled))
    if np.any(tables.filled[order] != tables.filled):
        return False
    away = (mirrored_cells(tables.rest) - tables.rest) / tables.scale
    return bool(np.sqrt(np.square(away).sum(axis=-1).mean()) <= ALIKE)


def _places(columns: int) -> np.ndarray:
    """Return the column that each shows in the mirror; column 0 looks ahead."""
    return -np.arange(columns) % columns
