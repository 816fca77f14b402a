"""What a column sees of the motion: how its anchor moves, and where the body is beside it (host, causal)."""

import numpy as np

from garment_jax.body.carried import pose_carried
from garment_jax.body.root_frame import carry_over, heading
from garment_jax.dataset.template import ColumnTables
from garment_jax.model.column_rnn.tables import LEVELS, sector
from garment_jax.structs import ColumnFrame, Motion, Scene

# what counts as 1 in each feature, metres (a frame, for movements; a frame squared, for their change)
OFFSET, MOVED, CHANGED, RADIUS, GREW = 0.03, 0.03, 0.015, 0.15, 0.03
USUAL_RADIUS = 0.2  # metres, of a body at its hips
LARGEST = 6.0  # of any feature: farther out there was nothing to learn from
FASTEST = 0.2  # metres a frame that an anchor leaves its cloth behind: 6 m/s at 30 fps
MOST_TURN = 0.5  # radians a frame that a body leaves its cloth behind: 860 degrees a second at 30 fps
BEFORE = 2  # frames that the features of one frame look back
AT_ONCE = 256  # frames: a long motion's body would fill the memory
FEATURES = 9 + 2 * LEVELS  # numbers a column


def column_frames(
    motion: Motion, scene: Scene, tables: ColumnTables, frames: slice | None = None
) -> ColumnFrame:
    """Return the frames `frames` of `motion` (all unless given), leaves `[t, ...]` float32.

    Frame 0 has no predecessor: there the body is at rest.
    """
    frames = frames or slice(0, len(motion.root))
    starts = range(frames.start, frames.stop, AT_ONCE)
    pieces = [_seen(motion, scene, tables, slice(s, min(s + AT_ONCE, frames.stop))) for s in starts]
    return pieces[0] if len(pieces) == 1 else ColumnFrame(*map(np.concatenate, zip(*pieces, strict=True)))


def _seen(motion: Motion, scene: Scene, tables: ColumnTables, frames: slice) -> ColumnFrame:
    first = max(frames.start - BEFORE, 0)
    cut = slice(first, frames.stop)
    root, yaw = motion.root[cut].astype(np.float64), heading(motion.rotations[cut, 0])
    posed = pose_carried(tables.carried, scene, motion, cut)
    anchor = tables.anchors @ posed.pins  # as an einsum it took more time than all else here
    turn, shift = carry_over(root, yaw)
    before = np.maximum(np.arange(len(root)) - 1, 0)

    def carried(x: np.ndarray) -> np.ndarray:
        return np.einsum("tai,tij->taj", x[before], turn)

    def local(x: np.ndarray) -> np.ndarray:
        return np.einsum("aij,taj->tai", tables.frames, x)

    moved = anchor - carried(anchor) - shift[:, None]
    changed = moved - carried(moved)
    moved[0], changed[:2] = (0.0, 0.0) if first == 0 else (moved[0], changed[:2])
    centre = anchor.mean(axis=1, keepdims=True)
    radius = _radius(posed.collider - centre, tables)
    way = local(moved)
    seen = np.concatenate(
        [
            (local(anchor - centre) - tables.centre) / OFFSET,
            way / MOVED,
            local(changed) / CHANGED,
            (radius - USUAL_RADIUS) / RADIUS,
            (radius - radius[before]) / GREW,
        ],
        axis=-1,
    )
    kept = slice(frames.start - first, None)
    angle = np.clip(np.arctan2(turn[:, 2, 0], turn[:, 0, 0]), -MOST_TURN, MOST_TURN)
    return ColumnFrame(
        np.clip(seen, -LARGEST, LARGEST).astype(np.float32)[kept],
        np.clip(way, -FASTEST, FASTEST).astype(np.float32)[kept],
        angle.astype(np.float32)[kept],
        anchor.astype(np.float32)[kept],
    )


def _radius(points: np.ndarray, tables: ColumnTables) -> np.ndarray:
    """Return how far the body reaches from the axis in each sector and level, `[t, a, LEVELS]` metres.

    `points` `[t, q, 3]` are given from the anchors' centre; 0 where there is none of them.
    """
    t, q, a = *points.shape[:2], len(tables.frames)
    if not q:
        return np.zeros((t, a, LEVELS), np.float32)
    high, low = tables.levels[0], tables.levels[-1]
    level = np.floor((high - points[..., 1]) * (LEVELS / (high - low))).astype(np.int64)
    # one flat index a point, the last for those above and below: NumPy is several times faster by it
    at = (np.arange(t)[:, None] * a + sector(points, a)) * LEVELS + level
    at = np.where((level >= 0) & (level < LEVELS), at, t * a * LEVELS)
    out = np.zeros(t * a * LEVELS + 1, np.float32)
    r = np.minimum(np.hypot(points[..., 0], points[..., 2]), tables.farthest).astype(np.float32)
    np.maximum.at(out, at.ravel(), r.ravel())
    return out[:-1].reshape(t, a, LEVELS)
