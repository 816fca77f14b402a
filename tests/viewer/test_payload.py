import zlib

import numpy as np
import pytest

from garment_jax.viewer.payload import STEP, Walk, make_walk, pack_array, pack_chunk, quantise, step_for
from tests.reference.scene import make_scene
from tests.viewer.unpacking import unpack_chunk


def inflated(steps, walk):
    return unpack_chunk(zlib.decompress(pack_chunk(steps, walk)), walk.order, walk.parent)


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_a_chunk_comes_back_exactly_even_where_differences_wrap(frames):
    garment = make_scene(4, 6).garment
    n = len(garment.template)
    walk = make_walk(garment.faces, n)
    steps = np.random.default_rng(0).integers(-32_768, 32_768, (frames, n, 3)).astype(np.int16)
    np.testing.assert_array_equal(inflated(steps, walk), steps)


def test_every_vertex_follows_a_neighbour_that_came_before():
    faces = np.array([[5, 1, 2], [2, 1, 7], [8, 9, 10]], np.int32)  # two parts; 0, 3, 4, 6 are in no face
    walk = make_walk(faces, 11)
    assert sorted(walk.order) == list(range(11))
    pairs = {(a, b) for f in faces for a in f for b in f if a != b}
    for rank, parent in enumerate(walk.parent):
        assert parent < rank
        if parent >= 0:
            assert (walk.order[parent], walk.order[rank]) in pairs
    assert (walk.parent < 0).sum() == 6


def test_the_walk_makes_any_order_of_vertices_cheap():
    scene = make_scene(24, 24)
    T, faces = scene.garment.template, scene.garment.faces
    time = np.linspace(0, 1, 16)[:, None, None]
    V = T[None] + 0.05 * np.sin(6 * time + 4 * T[None])
    shuffle = np.random.default_rng(1).permutation(len(T))
    number = np.argsort(shuffle)
    usual = len(pack_chunk(quantise(V, STEP), make_walk(faces, len(T))))
    mixed = quantise(V[:, shuffle], STEP)
    as_stored = Walk(np.arange(len(T), dtype=np.int32), np.arange(-1, len(T) - 1, dtype=np.int32))
    walked, stored = (len(pack_chunk(mixed, w)) for w in (make_walk(number[faces], len(T)), as_stored))
    assert walked < 0.75 * stored
    plain = quantise(V, STEP)
    assert usual < 0.5 * len(zlib.compress(plain.tobytes(), 6))


def test_positions_are_off_by_half_a_step_at_most():
    V = np.random.default_rng(0).uniform(-1, 1, (3, 40, 3))
    assert np.abs(quantise(V, STEP) * STEP - V).max() <= STEP / 2 * (1 + 1e-9)


def test_far_vertices_get_a_larger_step_and_are_refused_with_a_small_one():
    assert step_for(1.6) == STEP
    far = np.array([[[9.0, -9.0, 0.0]]])
    step = step_for(9.0)
    assert np.abs(quantise(far, step) * step - far).max() <= step / 2
    with pytest.raises(ValueError, match=r"9\.000 m from the root"):
        quantise(far, STEP)


def test_arrays_are_little_endian():
    values = np.array([1, 258], ">u4")
    assert zlib.decompress(pack_array(values)) == bytes([1, 0, 0, 0, 2, 1, 0, 0])
