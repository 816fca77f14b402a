import numpy as np
import pytest

from garment_jax.geometry.uv_atlas import make_atlas
from garment_jax.structs import Garment
from tests.reference.scene import make_scene

GARMENT = make_scene(5, 8).garment


def triangle(uv: list[tuple[float, float]]) -> Garment:
    """One triangle in space with the given UVs."""
    template = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    face = np.array([[0, 1, 2]], np.int32)
    return Garment(template, face, np.array(uv, np.float32), face)


@pytest.mark.parametrize("size", [8, 16, 17])
def test_texel_weights_and_vertex_weights_sum_to_1(size):
    atlas = make_atlas(GARMENT, size)
    assert atlas.coverage.shape == (size, size)
    for stencil, columns in ((atlas.to_map, len(GARMENT.template)), (atlas.from_map, size * size)):
        np.testing.assert_allclose(stencil.weight.sum(axis=1), 1, atol=1e-5)
        assert stencil.weight.min() > -1e-5
        assert 0 <= stencil.index.min() <= stencil.index.max() < columns


def test_a_chart_over_the_whole_square_covers_every_texel():
    assert make_atlas(GARMENT, 16).coverage.all()


def test_coverage_of_half_a_square_is_the_closed_triangle():
    atlas = make_atlas(triangle([(0, 0), (1, 0), (0, 1)]), 9)
    row, column = np.indices((9, 9))
    np.testing.assert_array_equal(atlas.coverage, row + column <= 8)


def test_texels_outside_repeat_the_nearest_covered_texel():
    size = 9
    atlas = make_atlas(triangle([(0, 0), (1, 0), (0, 1)]), size)
    inside = np.argwhere(atlas.coverage)
    weight = np.zeros((size * size, 3))
    for texel in range(size * size):
        np.add.at(weight[texel], atlas.to_map.index[texel], atlas.to_map.weight[texel])
    for row, column in np.argwhere(~atlas.coverage):
        distance = np.square(inside - [row, column]).sum(axis=1)
        nearest = inside[distance == distance.min()]
        candidates = weight[nearest[:, 0] * size + nearest[:, 1]]
        assert np.abs(candidates - weight[row * size + column]).max(axis=1).min() < 1e-6


def test_a_vertex_on_a_texel_reads_that_texel_alone():
    atlas = make_atlas(triangle([(0, 0), (1, 0), (0.5, 0.25)]), 9)
    for vertex, texel in ((0, 0), (1, 8), (2, 2 * 9 + 4)):
        read = np.zeros(81)
        np.add.at(read, atlas.from_map.index[vertex], atlas.from_map.weight[vertex])
        assert read[texel] == pytest.approx(1)
        assert np.delete(read, texel) == pytest.approx(0)


def test_a_flipped_triangle_is_covered_too():
    plain, flipped = (
        make_atlas(triangle(uv), 9) for uv in ([(0, 0), (1, 0), (0, 1)], [(0, 0), (0, 1), (1, 0)])
    )
    np.testing.assert_array_equal(plain.coverage, flipped.coverage)


@pytest.mark.parametrize("value", [1.2, -0.3, np.nan])
def test_uvs_outside_the_unit_square_are_refused(value):
    uv = GARMENT.uv.copy()
    uv[3, 0] = value
    with pytest.raises(ValueError, match=r"normalise them to \[0, 1\]"):
        make_atlas(GARMENT._replace(uv=uv), 16)


def test_a_garment_without_uvs_is_refused():
    with pytest.raises(ValueError, match="no UVs; unwrap"):
        make_atlas(GARMENT._replace(uv=np.zeros((0, 2), np.float32)), 16)


def test_charts_too_small_for_a_texel_are_refused():
    small = triangle([(0.51, 0.51), (0.52, 0.51), (0.51, 0.52)])
    with pytest.raises(ValueError, match=r"8 x 8 map; enlarge uv\.size"):
        make_atlas(small, 8)


def test_an_unused_vertex_is_refused_by_number():
    template = np.concatenate([GARMENT.template, [[0, 1, 0]]]).astype(np.float32)
    with pytest.raises(ValueError, match=f"vertex {len(GARMENT.template)} belongs to no triangle"):
        make_atlas(GARMENT._replace(template=template), 16)


def _turn(a, b):
    return a[0] * b[..., 1] - a[1] * b[..., 0]


def test_charts_that_overlap_give_a_texel_to_the_last_in_batches_of_any_size(monkeypatch):
    rng = np.random.default_rng(0)
    uv = rng.random((39, 2)).astype(np.float32)
    faces_uv = np.concatenate([rng.permutation(39).reshape(-1, 3) for _ in range(3)]).astype(np.int32)
    garment = Garment(rng.random((39, 3)).astype(np.float32), faces_uv, uv, faces_uv)
    whole = make_atlas(garment, 24)
    row, column = np.divmod(np.arange(24 * 24), 24)
    seen = np.full(24 * 24, -1)
    for f, (a, b, c) in enumerate(uv[faces_uv].astype(float) * 23):  # by the sides of the edges
        p = np.stack([column, row], axis=1)
        turns = np.array([_turn(q - o, p - o) for o, q in ((a, b), (b, c), (c, a))])
        turns *= np.sign(_turn(b - a, c - a))
        seen[(turns >= -1e-6).all(axis=0)] = f
    np.testing.assert_array_equal(whole.coverage.ravel(), seen >= 0)
    inside = np.flatnonzero(seen >= 0)
    for texel in inside:
        read = whole.to_map.index[texel][whole.to_map.weight[texel] > 1e-6]
        assert set(read) <= set(faces_uv[seen[texel]])
    monkeypatch.setattr("garment_jax.geometry.uv_atlas.AT_ONCE", 7)
    for a, b in zip(whole.to_map, make_atlas(garment, 24).to_map, strict=True):
        np.testing.assert_array_equal(a, b)
