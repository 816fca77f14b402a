"""Batches: a function of the step alone, frames of the right clips, mirrored where the clip is."""

import numpy as np
import pytest

from garment_jax.body.seeds import make_seeds
from garment_jax.config import MotionConfig
from garment_jax.dataset.batches import (
    lane_inputs,
    lane_latents,
    lane_schedule,
    lane_starts,
    lane_vertices,
    lane_weights,
    random_frames,
    spread_frames,
)
from garment_jax.dataset.lanes import LaneWindow
from garment_jax.dataset.motion_input import MotionInput
from garment_jax.dataset.prepared import DataSet, PreparedClip, frames_of, targets_of, unposed_targets_of
from garment_jax.dataset.template import Statistics
from garment_jax.structs import FrameInput, Motion
from tests.reference.scene import make_scene

LENGTHS = (11, 7, 11, 7)  # two clips and their mirror images
N, WINDOW = 4, 3
MIRROR = np.array([1, 0, 3, 2])


def clip_of(number: int, frames: int, *, mirrored: bool) -> PreparedClip:
    """A clip whose every value says where it comes from: 100 x clip + frame, plus a part for the vertex."""
    frame = 100.0 * number + np.arange(frames, dtype=np.float32)
    V = frame[:, None, None] + np.arange(N, dtype=np.float32)[:, None] / 8 + np.zeros(3, np.float32)
    x = FrameInput(
        frame[:, None] + np.zeros(2, np.float32),
        frame[:, None, None] + np.eye(3),
        frame[:, None] + np.zeros(3),
    )
    R = frame[:, None, None, None] + np.zeros((1, 2, 3, 3), np.float32)
    inputs = MotionInput(x, R, R[..., 0], frame[:, None] + np.zeros(3), frame.astype(float))
    motion = Motion(np.tile(np.eye(3, dtype=np.float32), (frames, 1, 1, 1)), np.zeros((frames, 3)), 30.0)
    return PreparedClip(f"clip_{number}", V, V + 500.0, V + 1000.0, inputs, mirrored, motion)


@pytest.fixture(scope="module")
def data() -> DataSet:
    recorded = [clip_of(k, LENGTHS[k], mirrored=False) for k in (0, 1)]
    mirrored = [clip._replace(name=f"{clip.name} mirrored", mirrored=True) for clip in recorded]
    zeros = Statistics(*(np.zeros(3, np.float32) for _ in range(6)))
    scene = make_scene(4, 8)
    return DataSet(scene, make_seeds(scene, 4), recorded + mirrored, [], zeros, MIRROR, "hash", 30.0)


LANES = LaneWindow(
    clip=np.array([0, 1, 2, 0]),
    start=np.array([0, 2, 4, 5]),
    fresh=np.array([True, True, True, False]),
    true_start=np.array([True, False, True, True]),
    age=np.zeros(4, int),
)


def test_mirrored_frames_exchange_partners_and_flip_x(data: DataSet):
    which = np.array([3, 4])
    for of, more in ((frames_of, 0.0), (targets_of, 500.0), (unposed_targets_of, 1000.0)):
        there = frames_of(data.train[0], which, data) + np.float32(more)
        np.testing.assert_array_equal(of(data.train[2], which, data), there[:, MIRROR] * [-1, 1, 1])


def test_random_frames_depend_on_seed_and_step_alone_and_reach_every_clip(data: DataSet):
    V, T_tilde = random_frames(data, 64, seed=1, step=5)
    assert V.shape == T_tilde.shape == (64, N, 3)
    again = random_frames(data, 64, seed=1, step=5)
    np.testing.assert_array_equal(again[0], V)
    np.testing.assert_array_equal(again[1], T_tilde)
    assert not np.array_equal(random_frames(data, 64, seed=1, step=6)[0], V)
    assert not np.array_equal(random_frames(data, 64, seed=2, step=5)[0], V)
    np.testing.assert_array_equal(T_tilde[..., 1] - V[..., 1], 500.0)  # pairs stay together
    side, number = np.sign(V[:, 0, 0] + 1e-6), V[:, 0, 1] // 100 - 5
    assert {(a, b) for a, b in zip(side, number, strict=True)} == {(1, 0), (1, 1), (-1, 0), (-1, 1)}


def test_spread_frames_come_from_every_clip(data: DataSet):
    V, T_tilde = (spread_frames(data, 12, of) for of in (targets_of, unposed_targets_of))
    assert len(V) == len(T_tilde) == 12
    clip = {(int(y) // 100, bool(x > 0)) for x, y in zip(V[:, 1, 0], V[:, 0, 1], strict=True)}
    assert len(clip) == 4
    assert len(spread_frames(data, 1000)) == sum(LENGTHS)


def test_lanes_read_inputs_codes_and_vertices_of_one_window(data: DataSet):
    x, V = lane_inputs(data, LANES, WINDOW), lane_vertices(data, LANES, WINDOW)
    Z = [np.asarray(clip.input.x.M, np.float32) for clip in data.train]
    latents = lane_latents(Z, LANES, WINDOW)
    assert x.M.shape == (WINDOW, 4, 2)
    assert x.turn.shape == (WINDOW, 4, 3, 3)
    assert V.shape == (WINDOW, 4, N, 3)
    np.testing.assert_array_equal(latents, x.M)
    np.testing.assert_array_equal(x.M[:, 1, 0], [102, 103, 104])
    np.testing.assert_array_equal(np.floor(V[:, 1, 0, 1]), [102, 103, 104])
    np.testing.assert_array_equal(V[:, 2], frames_of(data.train[2], np.arange(4, 7), data))


def test_lanes_begin_from_the_frame_before_true_or_skinned(data: DataSet):
    asked = {}

    def skinned(R: np.ndarray, t: np.ndarray) -> np.ndarray:
        asked["R"], asked["t"] = R, t
        return np.full((len(R), N, 3), -5.0, np.float32)

    V = lane_starts(data, LANES, skinned, N)
    np.testing.assert_array_equal(asked["R"][:, 0, 0, 0], [0, 101, 3, 4])
    np.testing.assert_array_equal(V[0], data.train[0].U[0])  # a clip's first frame has no predecessor
    assert (V[1] == -5).all()
    np.testing.assert_array_equal(V[2], targets_of(data.train[2], np.array([3]), data)[0])
    on = LANES._replace(fresh=np.zeros(4, bool))
    assert not lane_starts(data, on, skinned, N).any()


def test_schedule_and_weights_follow_the_configuration(data: DataSet):
    config = MotionConfig(window=WINDOW, lane_windows=2, from_first=0.0, true_starts=0.0, grace=6)
    windows = lane_schedule(data, config, lanes=3, steps=9, seed=0)
    assert len(windows) == 9
    assert all(len(lanes.clip) == 3 for lanes in windows)
    assert not any(lanes.true_start.any() for lanes in windows)
    for lanes in windows:
        weight = lane_weights(lanes, config)
        began_later = lanes.start - lanes.age > 0
        assert weight.shape == (WINDOW, 3)
        assert (weight[0, began_later & lanes.fresh] == np.float32(0.2)).all()
        assert (weight[:, ~began_later] == 1).all()
