"""The ring's static tables against slow loops."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from garment_jax.model.column_rnn.network import cells_of, corrected
from garment_jax.model.column_rnn.tables import has_ring, make_column_tables, sector
from garment_jax.procedural.scene import make_scene
from tests.animation.tiny_model import SCENE
from tests.reference.tiny_column_rnn import COLUMNS, tables

A, H = COLUMNS.columns, COLUMNS.rows
T = (SCENE.garment.template - SCENE.body.joints[0]).astype(np.float64)
PINS = SCENE.pins.vertices
ANCHOR = tables().anchors @ T[PINS]


def moved(d: np.ndarray) -> np.ndarray:
    """Return how far each vertex goes when every cell is moved by `d` in the root frame."""
    X = (
        np.asarray(cells_of(jnp.asarray(T), jnp.asarray(ANCHOR), tables=tables()))
        + np.einsum("aij,j->ai", tables().frames, d)[:, None]
    )
    return (
        np.asarray(
            corrected(jnp.asarray(T), jnp.asarray(X), jnp.asarray(ANCHOR), tables=tables(), weight=1.0)
        )
        - T
    )


def test_frames_point_outwards_around_and_up():
    F = tables().frames
    np.testing.assert_allclose(F @ np.swapaxes(F, 1, 2), np.broadcast_to(np.eye(3), F.shape), atol=1e-6)
    for k in range(A):
        angle = 2 * np.pi * k / A
        np.testing.assert_allclose(F[k, 0], [np.sin(angle), 0, np.cos(angle)], atol=1e-6)
        np.testing.assert_allclose(F[k, 2], [0, 1, 0], atol=1e-6)
    assert (tables().rest[:, -1, 0] > 0).all()  # a cone's hem lies outside its waist
    assert (tables().rest[..., 2] < 0).all()


def test_a_sector_is_the_nearest_columns():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(200, 3))
    flat = points[:, [0, 2]] / np.linalg.norm(points[:, [0, 2]], axis=1, keepdims=True)
    directions = tables().frames[:, 0][:, [0, 2]]
    np.testing.assert_array_equal(sector(points, A), (flat @ directions.T).argmax(axis=1))


def test_a_shift_of_all_cells_shifts_the_cloth_and_leaves_the_pins():
    d = 1e-2 * np.array([0.03, -0.01, 0.02])
    shift = 1e2 * moved(d)  # so little that no reach is felt
    d = 1e2 * d
    np.testing.assert_allclose(shift[PINS], 0.0, atol=1e-5)
    rings = shift.reshape(8, 16, 3)
    part = rings @ d / (d @ d)
    np.testing.assert_allclose(rings, part[..., None] * d, atol=2e-5)  # along d alone
    # rows -2 to H of the spline: straight through 0 at the pins, and on beyond the hem
    spline = BSpline(np.arange(H + 7.0) - 4.0, np.r_[-1.0, 0.0, np.ones(H + 1)], 3)
    np.testing.assert_allclose(part, spline(np.arange(8) / 7 * H - 1)[:, None].repeat(16, 1), atol=0.02)


def test_what_differs_from_column_to_column_is_smoothed_away():
    comb = np.where(np.arange(A) % 2, -1.0, 1.0)[:, None, None] * np.ones((1, H, 3))
    index, weight = tables().up.index, tables().up.weight
    folded = (comb.reshape(-1, 3)[index] * weight[..., None]).sum(axis=1)
    assert 0.2 < np.abs(folded).max() < 0.34  # a third: 4/6 - 2/6 at the columns themselves


def test_a_correction_brings_the_cells_nearer_and_none_moves_nothing():
    rng = np.random.default_rng(1)
    cells = np.asarray(cells_of(jnp.asarray(T), jnp.asarray(ANCHOR), tables=tables()))
    bend = 0.02 * np.sin(2 * np.pi * np.arange(A) / A)[:, None, None] * np.ones((1, H, 3))
    there = np.asarray(
        corrected(jnp.asarray(T), jnp.asarray(cells + bend), jnp.asarray(ANCHOR), tables=tables(), weight=1.0)
    )
    off = np.asarray(cells_of(jnp.asarray(there), jnp.asarray(ANCHOR), tables=tables())) - cells - bend
    assert np.abs(off).max() < 0.75 * np.abs(bend).max()
    same = np.asarray(
        corrected(jnp.asarray(T), jnp.asarray(cells), jnp.asarray(ANCHOR), tables=tables(), weight=1.0)
    )
    np.testing.assert_allclose(same, T, atol=1e-6)
    anywhere = cells + rng.normal(size=cells.shape)
    np.testing.assert_allclose(
        corrected(jnp.asarray(T), jnp.asarray(anywhere), jnp.asarray(ANCHOR), tables=tables(), weight=0.0),
        T,
        atol=1e-7,
    )


def test_cells_are_means_of_the_vertices_around():
    total = tables().down.weight.sum(axis=1)
    np.testing.assert_allclose(total[tables().filled.ravel() > 0], 1.0, atol=1e-5)
    assert tables().down.weight.min() >= 0
    assert tables().share.sum() == pytest.approx(1.0, abs=1e-5)
    assert tables().filled.all()
    np.testing.assert_allclose(tables().anchors.sum(axis=1), 1.0, atol=1e-6)


def test_a_garment_that_is_open_has_empty_columns():
    garment = SCENE.garment
    centre = garment.template[PINS].mean(axis=0)
    kept = (garment.template - centre)[garment.faces].mean(axis=1)[:, 2] < -0.02  # its back half
    used = np.unique(garment.faces[kept])
    number = np.full(len(garment.template), -1)
    number[used] = np.arange(len(used))
    faces = number[garment.faces[kept]].astype(np.int32)
    half = garment._replace(template=garment.template[used], faces=faces)
    held = np.isin(PINS, used)
    pins = SCENE.pins._replace(vertices=number[PINS[held]].astype(np.int32), weights=SCENE.pins.weights[held])
    open_tables = make_column_tables(SCENE._replace(garment=half, pins=pins), config=COLUMNS)
    assert not open_tables.filled[0].any()  # straight ahead
    assert open_tables.filled[A // 2].all()
    assert np.isfinite(open_tables.rest).all()
    assert (open_tables.share[open_tables.filled == 0] < 1e-3).all()
    # what the ring says of a cell without cloth moves nothing
    X = np.where(open_tables.filled[..., None] > 0, open_tables.rest, np.nan)
    made = corrected(
        jnp.asarray(half.template), jnp.asarray(X), jnp.asarray(ANCHOR), tables=open_tables, weight=1.0
    )
    assert np.isfinite(made).all()


def test_a_part_without_pins_is_refused():
    with pytest.raises(ValueError, match=r"parts that hang on none, .*; set column_rnn\.steps = 0"):
        make_column_tables(SCENE._replace(pins=None), config=COLUMNS)


def test_pins_in_a_line_are_no_ring():
    """A cape's along the shoulders; a skirt's, a dress', and half a ring's are one."""
    for garment, ring in (("cape", False), ("skirt", True), ("dress", True)):
        assert has_ring(make_scene(garment, vertices=300)) is ring
    with pytest.raises(ValueError, match="or pins in a line"):
        make_column_tables(make_scene("cape", vertices=300), config=COLUMNS)


@pytest.mark.parametrize("weight", [1.0, 0.7])
def test_a_correction_goes_its_part_of_the_way_however_far(weight: float):
    """From the template's cells: spread by the splines, and nothing in between holds it back."""
    cells = np.asarray(cells_of(jnp.asarray(T), jnp.asarray(ANCHOR), tables=tables()))
    way = np.random.default_rng(4).normal(size=cells.shape)
    for far in (0.0, 1e-4, 0.5, 100.0):
        X = cells + far * tables().scale * way
        made = corrected(jnp.asarray(T), jnp.asarray(X), jnp.asarray(ANCHOR), tables=tables(), weight=weight)
        away = weight * far * np.einsum("aij,ahi->ahj", tables().frames, tables().scale * way)
        index, share = tables().up.index, tables().up.weight
        wanted = (away.reshape(-1, 3)[index] * share[..., None]).sum(axis=1)
        np.testing.assert_allclose(np.asarray(made) - T, wanted, rtol=1e-4, atol=3e-6)
