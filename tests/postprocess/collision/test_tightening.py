"""Cloth that collision handling stretches is drawn back along the body; all else is as without."""

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.strain_limit import SHARE, STRETCH, StrainTables, limit_rate, make_strain_tables
from garment_jax.geometry.topology import unique_edges
from garment_jax.postprocess.collision import CollisionOptions, Outcome, initial_state
from garment_jax.postprocess.collision.tightening import resolve_unstretched
from garment_jax.structs import Garment
from tests.postprocess.collision.cloth import resolve, sheet, tables

SETTINGS = {"eps": 1e-3, "slack": 0.05, "iterations": 40, "rings": 6}
PINS = np.array([0, 23, 0, 23], np.int32)  # one side's ends: the cloth may slide
ROUNDING = 5e-6  # metres: two programs with the same steps
HARDLY = 0.1  # `limit_rate` of 0.55 % of the edges too long
DEEP, TOUCHING, FREE = 0.06, 0.2, 0.5  # heights of the sheet; the surface ends below 0.4
T, FACES = sheet()
EDGES = unique_edges(FACES)


def strain_of(longer: float = 1.0) -> StrainTables:
    """The sheet's, with its rest lengths times `longer`."""
    garment = Garment(longer * T, FACES, np.zeros((len(T), 2), np.float32), FACES)
    return make_strain_tables(garment, PINS)


@jax.jit
def unstretched(V, body, state, strain, pins, pin_positions, settings):
    options = CollisionOptions(sizes=())._replace(**settings)
    held = {"pins": pins, "pin_positions": pin_positions}
    return resolve_unstretched(
        V, body, state, tables=tables()[0], as_in=V, strain=strain, options=options, **held
    )


def both(V: np.ndarray, longer: float = 1.0):
    """The frame resolved without and with a care for lengths, and the states."""
    made, body, _ = tables()
    frame, C = jnp.asarray(V, jnp.float32), jnp.asarray(body)
    state = initial_state(frame, C, made.surface)
    return (
        resolve(frame, pins=PINS, **SETTINGS),
        unstretched(frame, C, state, strain_of(longer), jnp.asarray(PINS), frame[PINS], SETTINGS),
    )


def too_long(V) -> float:
    """Share of the edges longer than the limit."""
    V = np.asarray(V, np.float64)
    length = np.linalg.norm(V[EDGES[:, 1]] - V[EDGES[:, 0]], axis=1)
    return float((length / rest_lengths(T, EDGES) - 1 > STRETCH + 0.02).mean())


def test_cloth_that_was_pushed_out_is_no_longer_than_the_limit_and_still_outside():
    V = sheet(DEEP)[0]
    (plain, _), (result, state) = both(V)
    assert too_long(V) == 0
    assert too_long(plain.V) > 4 * SHARE
    assert too_long(result.V) < 2 * SHARE
    assert plain.penetrating_after == result.penetrating_after == 0
    assert result.penetrating_before == plain.penetrating_before > 0
    assert result.deepest_before == plain.deepest_before
    assert result.steps >= plain.steps
    np.testing.assert_array_equal(np.asarray(result.V)[PINS], V[PINS])
    free = ~np.isin(np.arange(len(V)), PINS)
    np.testing.assert_array_equal(np.asarray(state.correction).T[free], (np.asarray(result.V) - V)[free])


def test_a_frame_that_is_not_stretched_is_what_it_is_without():
    for height in (TOUCHING + 0.15, FREE):
        (plain, state), (result, following) = both(sheet(height)[0])
        assert too_long(plain.V) < SHARE
        for a, b in zip(jax.tree.leaves((plain, state)), jax.tree.leaves((result, following)), strict=True):
            np.testing.assert_allclose(a, b, atol=ROUNDING)


def test_hardly_too_many_long_edges_call_for_no_round():
    V = sheet(DEEP)[0]
    frame, (plain, _) = jnp.asarray(V, jnp.float32), both(V)[0]

    def rate(strain) -> float:
        return float(limit_rate(plain.V, strain, as_in=frame))

    short, long = 1.0, 2.0  # times the sheet's rest lengths: far too many long edges, and none
    for _ in range(24):
        strain = strain_of((short + long) / 2)
        if 0 < rate(strain) <= HARDLY:
            break
        short, long = ((short + long) / 2, long) if rate(strain) > 0 else (short, (short + long) / 2)
    assert 0 < rate(strain) <= HARDLY
    result = both(V, (short + long) / 2)[1][0]
    np.testing.assert_allclose(result.V, plain.V, atol=ROUNDING)
    assert np.abs(plain.V - both(V, 1.0)[1][0].V).max() > 100 * ROUNDING  # what rounds do


def test_cloth_that_came_in_stretched_may_stay_so():
    (plain, _), (result, _) = both(sheet(TOUCHING, width=1.5)[0])
    assert too_long(plain.V) > 0.9
    np.testing.assert_allclose(result.V, plain.V, atol=ROUNDING)


def test_a_broken_frame_comes_back_and_says_so():
    V = sheet(DEEP)[0]
    V[100] = np.nan
    _, (result, state) = both(V)
    assert result.outcome == Outcome.NOT_FINITE
    np.testing.assert_array_equal(result.V, V)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(state._replace(V=jnp.zeros(()))))
