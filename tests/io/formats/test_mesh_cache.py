"""Which mesh a name means, frames that are read when they are sliced."""

import numpy as np
import pytest

from garment_jax.io.formats.mesh_cache import Frames, choose_mesh


def test_which_mesh_is_meant():
    assert choose_mesh(["/a/Dress"], None, "x") == "/a/Dress"
    assert choose_mesh(["/a/Body", "/a/Garment"], None, "x") == "/a/Garment"
    assert choose_mesh(["/a/Body", "/a/Garment"], "body", "x") == "/a/Body"
    assert choose_mesh(["/a/m", "/b/m"], "/b/m", "x") == "/b/m"
    with pytest.raises(ValueError, match="2 meshes named 'm'"):
        choose_mesh(["/a/m", "/b/m"], "m", "x")
    with pytest.raises(ValueError, match="x holds several meshes"):
        choose_mesh(["/a/m", "/b/k"], None, "x")
    with pytest.raises(ValueError, match="x holds no mesh"):
        choose_mesh([], None, "x")


def test_frames_are_read_by_windows_alone():
    asked = []

    def read(start: int, stop: int) -> np.ndarray:
        asked.append((start, stop))
        return np.full((stop - start, 2, 3), start, np.float32)

    frames = Frames((10, 2, 3), read)
    assert frames[3:5].shape == (2, 2, 3)
    assert frames[-1].shape == (2, 3)
    assert frames[8:20].shape == (2, 2, 3)
    assert asked == [(3, 5), (9, 10), (8, 10)]
    assert len(list(iter(frames))) == 10
    with pytest.raises(IndexError):
        frames[10]
