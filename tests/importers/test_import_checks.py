"""Vertices that are nowhere near the body are refused with their frame."""

import numpy as np
import pytest

from garment_jax.importers.import_checks import choose_encoding
from garment_jax.importers.sources import ForeignClip
from tests.reference.scene import make_motion, make_scene, make_vertices

SCENE = make_scene()
MOTION = make_motion(SCENE, 100)
V = make_vertices(SCENE, MOTION)


def clip(frame: int, vertex: int, y: float) -> ForeignClip:
    """A clip of which one vertex is `y` metres above the root."""
    moved = V.copy()
    moved[frame, vertex, 1] = MOTION.root[frame, 1] + y
    return ForeignClip(SCENE, MOTION, lambda size: iter(np.split(moved, range(size, len(moved), size))))


def test_vertex_a_kilometre_away_is_refused_with_its_frame() -> None:
    assert choose_encoding(clip(70, 5, 999.0), "walk.pc2") == "float32"
    with pytest.raises(
        ValueError, match=r"^walk\.pc2: vertex 5 of frame 70 is 100\d m from the body's root; cut"
    ):
        choose_encoding(clip(70, 5, 1001.0), "walk.pc2")
    with pytest.raises(ValueError, match=r"vertex 3 of frame 99 is 1e\+08 m from"):
        choose_encoding(clip(99, 3, 1e8), "walk.pc2")


def test_vertex_that_is_no_number_is_refused_with_its_frame() -> None:
    for value in (np.nan, np.inf, 1e38):
        with pytest.raises(ValueError, match=r"vertex 3 of frame 64 is "):
            choose_encoding(clip(64, 3, value), "walk.pc2")
