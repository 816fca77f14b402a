"""Frames that are read in stretches are those of the array, whatever is asked in whatever order."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from garment_jax.body import frame_windows
from garment_jax.body.frame_windows import FrameWindows, stretches
from garment_jax.body.motion_features import ALL, motion_features
from garment_jax.body.preroll import with_preroll
from garment_jax.body.root_frame import heading, headings
from garment_jax.dataset.motion_input import frame_inputs, motion_input
from tests.animation.tiny_model import seeds
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()


@pytest.fixture(autouse=True)
def _short_stretches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_windows, "AT_ONCE", 8)


def windows_of(array: np.ndarray) -> tuple[FrameWindows, list[int]]:
    """Return the array behind a function, and how many frames were read at a time."""
    read: list[int] = []

    def some(start: int, stop: int) -> np.ndarray:
        read.append(stop - start)
        return array[start:stop]

    return FrameWindows(some, array.shape, array.dtype.str), read


def test_slices_are_the_arrays_and_little_is_read_at_a_time():
    array = np.random.default_rng(0).normal(size=(30, 4, 3)).astype(np.float32)
    windows, read = windows_of(array)
    assert (windows.shape, windows.ndim, windows.size, len(windows)) == (array.shape, 3, array.size, 30)
    for cut in (
        slice(0, 5),
        slice(6, 19),
        slice(29, 30),
        slice(28, 99),
        slice(7, 7),
        slice(None),
        slice(-3, None),
    ):
        np.testing.assert_array_equal(windows[cut], array[cut])
        np.testing.assert_array_equal(windows[cut, 1], array[cut, 1])
    assert max(read) == 8
    assert windows[3:3].dtype == np.float32
    np.testing.assert_array_equal(np.asarray(windows), array)


def test_neighbours_are_read_once():
    windows, read = windows_of(np.arange(64.0))
    for start in range(0, 64, 2):
        windows[max(start - 3, 0) : start + 2]
    assert read == [8] * 8


def test_what_is_no_stretch_is_refused():
    windows, _ = windows_of(np.arange(10.0))
    for key in (slice(0, 9, 2), (3, 1), (np.array([1, 2]), 0)):
        with pytest.raises(TypeError, match=r"give start:stop"):
            windows[key]


def test_threads_get_their_own_frames():
    array = np.random.default_rng(1).normal(size=(200, 3))
    windows, _ = windows_of(array)

    def check(seed: int) -> None:
        for start in np.random.default_rng(seed).integers(0, 190, size=200):
            np.testing.assert_array_equal(windows[start : start + 10], array[start : start + 10])

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(check, range(4)))


def test_stretches_cover_every_frame_once_with_those_before_it():
    assert list(stretches(20)) == [(0, slice(0, 8)), (0, slice(8, 16)), (0, slice(16, 20))]
    assert list(stretches(20, before=3)) == [(0, slice(0, 8)), (3, slice(5, 16)), (3, slice(13, 20))]
    assert list(stretches(0)) == []


def test_features_headings_and_inputs_of_a_stretch_are_those_of_the_whole():
    motion = make_motion(SCENE, 21)
    stored = motion._replace(rotations=windows_of(motion.rotations)[0])
    whole = motion_features(motion, SCENE.body, ALL)
    inputs = motion_input(motion, SCENE, seeds(), ("LeftLeg",)).x
    for frames in (slice(0, 1), slice(0, 8), slice(5, 13), slice(20, 21)):
        np.testing.assert_allclose(
            motion_features(stored, SCENE.body, ALL, frames)[1:], whole[frames][1:], atol=1e-6
        )
        found = frame_inputs(stored, SCENE, ("LeftLeg",), frames)
        if frames.stop > 1:  # a single frame has no successor to take its velocity from
            for a, b in zip(found[:5], inputs[:5], strict=True):
                np.testing.assert_allclose(a, b[frames], atol=1e-6)
    np.testing.assert_array_equal(headings(stored), heading(motion.rotations[:, 0]))


def test_a_preroll_goes_in_front_of_what_is_read_in_stretches():
    motion = make_motion(SCENE, 21)
    stored = motion._replace(rotations=windows_of(motion.rotations)[0])
    expected, found = with_preroll(motion, 13), with_preroll(stored, 13)
    assert isinstance(found.rotations, FrameWindows)
    np.testing.assert_array_equal(np.asarray(found.rotations), expected.rotations)
    np.testing.assert_array_equal(found.rotations[10:16], expected.rotations[10:16])
    np.testing.assert_array_equal(found.root, expected.root)
