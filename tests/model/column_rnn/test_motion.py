"""What columns see of a motion, against slow loops in the world frame."""

import numpy as np

from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.root_frame import from_root, heading
from garment_jax.model.column_rnn.motion import (
    CHANGED,
    FASTEST,
    LARGEST,
    MOVED,
    RADIUS,
    USUAL_RADIUS,
    column_frames,
)
from garment_jax.model.column_rnn.tables import LEVELS
from garment_jax.structs import Motion
from tests.animation.tiny_model import SCENE
from tests.reference.tiny_column_rnn import COLUMNS, motion, tables

N = 12
MOTION = motion(N)
FRAMES = column_frames(MOTION, SCENE, tables())


def in_world() -> tuple[np.ndarray, np.ndarray]:
    """Return the anchors and the collider's points of the tiny motion, world frame."""
    posed = pose_carried(carried_points(SCENE, collider=True), SCENE, MOTION, slice(0, N))
    yaw = heading(MOTION.rotations[:, 0])
    pins, points = (from_root(x, MOTION.root, yaw) for x in (posed.pins, posed.collider))
    return np.einsum("ap,tpi->tai", tables().anchors, pins), points


def axes(t: int) -> np.ndarray:
    """Return the columns' frames in the world at frame t, `[a, 3, 3]`."""
    turn = heading(MOTION.rotations[:, 0])[t] + 2 * np.pi * np.arange(COLUMNS.columns) / COLUMNS.columns
    s, c, o, i = np.sin(turn), np.cos(turn), 0 * turn, 0 * turn + 1
    return np.stack([np.stack(r, -1) for r in ([s, o, c], [c, o, -s], [o, i, o])], axis=-2)


def test_ways_are_the_anchors_movement_in_the_world():
    anchor, _ = in_world()
    for t in range(1, N):
        moved = anchor[t] - anchor[t - 1]
        np.testing.assert_allclose(FRAMES.way[t], np.einsum("aij,aj->ai", axes(t), moved), atol=1e-5)
    np.testing.assert_array_equal(FRAMES.way[0], 0.0)
    np.testing.assert_allclose(FRAMES.seen[..., 3:6], np.clip(FRAMES.way / MOVED, -6, 6), atol=1e-5)
    change = anchor[7] - 2 * anchor[6] + anchor[5]
    local = np.einsum("aij,aj->ai", axes(7), change) / CHANGED
    np.testing.assert_allclose(FRAMES.seen[7, :, 6:9], np.clip(local, -LARGEST, LARGEST), atol=1e-3)


def test_the_radius_is_that_of_the_farthest_point_of_a_sector():
    anchor, points = in_world()
    t, levels = 5, tables().levels
    from_axis = points[t] - anchor[t].mean(axis=0)
    wanted = np.zeros((COLUMNS.columns, LEVELS))
    outward = axes(t)[:, 0]
    for p in from_axis:
        level = int((levels[0] - p[1]) // (levels[0] - levels[1]))
        if 0 <= level < LEVELS:
            k = int((outward @ p).argmax())
            wanted[k, level] = max(wanted[k, level], min(np.hypot(p[0], p[2]), tables().farthest))
    seen = FRAMES.seen[t, :, 9 : 9 + LEVELS] * RADIUS + USUAL_RADIUS
    assert (np.abs(seen - wanted) < 1e-4).mean() > 0.97  # a point on a border may fall to either side
    assert wanted.max() > 0.1


def test_pieces_are_the_whole_and_nothing_comes_from_the_future():
    for cut in (slice(0, 1), slice(1, 4), slice(2, 9), slice(5, N)):
        piece = column_frames(MOTION, SCENE, tables(), cut)
        for whole, part in zip(FRAMES, piece, strict=True):
            np.testing.assert_allclose(part, whole[cut], atol=2e-5)
    earlier = column_frames(Motion(MOTION.rotations[:6], MOTION.root[:6], 30.0), SCENE, tables())
    for whole, part in zip(FRAMES, earlier, strict=True):
        np.testing.assert_array_equal(part, whole[:6])


def test_where_the_body_stands_and_looks_does_not_matter():
    angle = 0.7
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    elsewhere = Motion(
        (turn @ MOTION.rotations).astype(np.float32),
        (MOTION.root @ turn.T + [3.0, 0.0, -2.0]).astype(np.float32),
        30.0,
    )
    for here, there in zip(FRAMES, column_frames(elsewhere, SCENE, tables()), strict=True):
        np.testing.assert_allclose(here, there, atol=2e-3)


def test_a_leap_is_held_within_bounds():
    root = MOTION.root.copy()
    root[6:] += 50.0
    seen = column_frames(MOTION._replace(root=root), SCENE, tables())
    assert np.abs(seen.way).max() <= FASTEST
    assert np.abs(seen.seen).max() <= LARGEST


def test_without_a_collider_no_body_is_seen():
    from garment_jax.model.column_rnn.tables import make_column_tables

    bare = SCENE._replace(collider=None)
    seen = column_frames(MOTION, bare, make_column_tables(bare, config=COLUMNS)).seen
    np.testing.assert_allclose(seen[..., 9 : 9 + LEVELS], -USUAL_RADIUS / RADIUS, atol=1e-6)
    np.testing.assert_allclose(seen[..., :9], FRAMES.seen[..., :9], atol=1e-5)
