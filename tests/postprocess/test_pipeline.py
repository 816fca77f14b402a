"""Frames resolved in stretches: the same as one after the other, with the figures of each."""

from functools import lru_cache, partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.chunks import scan_frames
from garment_jax.dataset.lanes import repeated_last
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.postprocess.collision import CollisionOptions, Outcome, initial_state, resolve_collisions
from garment_jax.postprocess.figures import FrameFigures, join_figures, per_frame_columns
from garment_jax.postprocess.pipeline import contact_init, contact_step
from garment_jax.postprocess.untangling import make_untangle_tables
from tests.postprocess.collision.cloth import sheet, tables
from tests.postprocess.frames import body_frames, contact_tables

PINS = np.array([0, 23, 552, 575], np.int32)
OPTIONS = CollisionOptions(iterations=40, rings=6)
HEIGHTS = (0.5, 0.21, 0.2, 0.2, 0.5, 0.2, 0.22, 0.3, 0.5)  # of the sheet; the surface ends below 0.4
STRETCH = 5  # the last stretch is padded


@lru_cache
def inputs() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Garment, pins and collider of a sheet that sinks into the bumpy surface and leaves it."""
    body = tables()[1]
    V = np.stack([sheet(height)[0] for height in HEIGHTS])
    return V, V[:, PINS], np.stack([body] * len(V))


@lru_cache
def resolver():
    return scan_frames(partial(contact_step, tables=contact_tables(PINS, OPTIONS)))


def start():
    V, pins, collider = inputs()
    first = jax.tree.map(itemgetter(0), body_frames(pins, collider))
    return contact_init(jnp.asarray(V[0]), first, tables=contact_tables(PINS, OPTIONS))


def resolve_all(V: np.ndarray, pins: np.ndarray, collider: np.ndarray) -> tuple[np.ndarray, FrameFigures]:
    """Resolve the frames stretch after stretch."""
    parts, figures, state = [], [], start()
    for first in range(0, len(V), STRETCH):
        piece = [repeated_last(x[first : first + STRETCH], STRETCH) for x in (V, pins, collider)]
        state, out, more = resolver()(state, jnp.asarray(piece[0]), body_frames(*piece[1:]))
        count = len(V[first : first + STRETCH])
        parts.append(np.asarray(out)[:count])
        figures.append(FrameFigures(*(np.asarray(x)[:count] for x in more)))
    return np.concatenate(parts), join_figures(figures)


@lru_cache
def resolved() -> tuple[np.ndarray, FrameFigures]:
    return resolve_all(*inputs())


def test_stretches_are_their_frames_one_after_the_other():
    made, _, _ = tables()
    V, figures = resolved()
    frame = jax.jit(partial(resolve_collisions, tables=made, pins=PINS, options=OPTIONS))
    V_f, pins, collider = map(jnp.asarray, inputs())
    state = initial_state(V_f[0], collider[0], made.surface)
    for t in range(len(V_f)):
        result, state = frame(V_f[t], collider[t], state, pin_positions=pins[t])
        np.testing.assert_allclose(V[t], result.V, atol=1e-6)
        assert figures.outcome[t] == result.outcome
        assert figures.penetrating_before[t] == result.penetrating_before
        np.testing.assert_allclose(figures.deepest_before[t], result.deepest_before, atol=1e-7)
        assert (figures.steps[t], figures.penetrating_after[t]) == (result.steps, result.penetrating_after)


def test_the_pop_is_the_largest_change_of_a_correction_and_the_first_frame_has_none():
    V, figures = resolved()
    correction = V.astype(np.float64) - inputs()[0]
    change = np.linalg.norm(np.diff(correction, axis=0), axis=-1).max(axis=1)
    np.testing.assert_allclose(figures.pop[1:], change, atol=1e-7)
    assert figures.pop[0] == 0
    assert figures.pop[1] > 0.01  # the sheet falls in at once
    assert figures.outcome[0] == figures.outcome[-1] == Outcome.NOTHING_TO_DO


def test_pins_that_are_put_in_their_place_are_no_correction():
    V, pins, collider = inputs()
    made = np.repeat(V[:1], len(V), axis=0)
    shifted = pins + np.arange(len(V), dtype=np.float32)[:, None, None]
    far, figures = resolve_all(made, shifted, collider)
    np.testing.assert_array_equal(far[:, PINS], shifted)
    np.testing.assert_array_equal(figures.pop, 0.0)


def test_columns_are_in_millimetres_and_one_a_frame():
    columns = per_frame_columns(resolved()[1])
    assert all(len(values) == len(HEIGHTS) for values in columns.values())
    np.testing.assert_allclose(columns["collision_pop_mm"], 1e3 * resolved()[1].pop)
    lengths = [name for name in columns if "deepest" in name or "pop" in name]
    assert len(lengths) == 3
    assert all(name.endswith("_mm") for name in lengths)


def test_a_nan_in_one_frame_does_not_reach_the_next_ones_pop():
    V, pins, collider = inputs()
    bad = V.copy()
    bad[2, 300, 1] = np.nan
    figures = resolve_all(bad, pins, collider)[1]
    assert figures.outcome[2] == Outcome.NOT_FINITE
    assert np.isfinite(figures.pop).all()


def test_cloth_within_the_body_and_within_itself_leaves_both():
    T, faces = sheet(0.5)
    body = tables()[1]
    frame = jax.tree.map(itemgetter(0), body_frames(T[None, PINS], body[None]))
    contacts = contact_tables(PINS, OPTIONS)._replace(untangle=make_untangle_tables(T, faces, PINS))
    turn = 4 * np.pi * T[:, 0]
    looped = np.stack([T[:, 0] - 0.1 * np.sin(turn), T[:, 1] - 0.3 - 0.1 * np.cos(turn), T[:, 2]], axis=1)
    looped[PINS] = T[PINS]
    step = jax.jit(partial(contact_step, tables=contacts))

    calm, _, _ = step(contact_init(jnp.asarray(T), frame, tables=contacts), jnp.asarray(T), frame)
    after, V, figures = step(calm, jnp.asarray(looped, jnp.float32), frame)
    assert self_intersections(looped, faces).edges > 20
    assert self_intersections(np.asarray(V), faces).edges == 0 == int(figures.self_crossings)
    assert int(figures.penetrating_before) > 0 == int(figures.penetrating_after)
    assert after.untangle is not None
    assert after.untangle.weight.any()
    np.testing.assert_array_equal(V[PINS], T[PINS])
