"""A standing body: its cloth comes to rest, goes with its prediction, and is resolved anew when it moves."""

from functools import lru_cache, partial
from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.animation.chunks import scan_frames
from garment_jax.geometry.closest_point import closest_point_exact
from garment_jax.postprocess.collision import CollisionOptions, Outcome
from garment_jax.postprocess.pipeline import contact_init, contact_step
from garment_jax.postprocess.rest import QUIET, SETTLE
from tests.postprocess.collision.cloth import sheet, tables
from tests.postprocess.frames import body_frames, contact_tables

PINS = np.array([0, 23, 552, 575], np.int32)
OPTIONS = CollisionOptions(eps=4e-3, iterations=10)  # too few: each frame goes on where the last one ended
SUNK = 0.2  # metres: the bumpy surface ends below 0.4
FRAMES = SETTLE + 6
KEPT = SETTLE  # the first frame that keeps the correction


@lru_cache
def resolver():
    return scan_frames(partial(contact_step, tables=contact_tables(PINS, OPTIONS)))


def resolved(V: np.ndarray, collider: np.ndarray):
    frames = body_frames(V[:, PINS], collider)
    first = jax.tree.map(itemgetter(0), frames)
    state = contact_init(jnp.asarray(V[0]), first, tables=contact_tables(PINS, OPTIONS))
    _, out, figures = resolver()(state, jnp.asarray(V), frames)
    return np.asarray(out), figures


def held() -> tuple[np.ndarray, np.ndarray]:
    """Return a sheet sunk into a body that stands, both the same in every frame."""
    return np.repeat(sheet(SUNK)[0][None], FRAMES, 0), np.repeat(tables()[1][None], FRAMES, 0)


def moves(V: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(V, axis=0), axis=-1).max(axis=1)


def test_cloth_on_a_standing_body_comes_to_rest_outside():
    V, figures = resolved(*held())
    assert moves(V)[: SETTLE - 1].min() > 1e-5  # it had not come to rest by itself
    np.testing.assert_array_equal(V[KEPT:], np.repeat(V[KEPT - 1 : KEPT], FRAMES - KEPT, 0))
    distance = closest_point_exact(jnp.asarray(V[-1]), jnp.asarray(tables()[1]), tables()[0].surface).ds
    free = np.setdiff1d(np.arange(len(V[0])), PINS)
    assert np.asarray(distance)[free].min() > 0.9 * OPTIONS.eps
    assert (figures.steps[KEPT:] == 0).all()
    assert (figures.pop[KEPT:] == 0).all()


def test_a_kept_frame_says_what_its_correction_was_found_as():
    _, figures = resolved(*held())
    assert figures.penetrating_before[KEPT - 1] > 0
    for kept in (figures.penetrating_before, figures.deepest_before, figures.outcome):
        assert (np.asarray(kept[KEPT:]) == kept[KEPT - 1]).all()
    assert (figures.penetrating_after == 0).all()


def creeping(way: float) -> np.ndarray:
    """Return the sheet's frames, moving by `way` metres a frame (negative: deeper) once they are kept."""
    V_f = held()[0]
    V_f[KEPT:, :, 1] += np.float32(way) * np.arange(FRAMES - KEPT, dtype=np.float32)[:, None]
    return V_f


def test_kept_cloth_goes_with_its_prediction():
    V_f = creeping(0.5 * QUIET)
    V, _ = resolved(V_f, held()[1])
    free = np.setdiff1d(np.arange(len(V[0])), PINS)
    correction = (V - V_f)[:, free]
    assert np.linalg.norm(correction[KEPT], axis=-1).max() > 0.02
    np.testing.assert_allclose(correction[KEPT:], np.repeat(correction[KEPT : KEPT + 1], 6, 0), atol=1e-6)


def test_kept_cloth_that_sinks_is_pushed_out():
    _, figures = resolved(creeping(-0.9 * QUIET), held()[1])
    assert (figures.steps[KEPT + 1 :] > 0).any()
    assert (figures.penetrating_after == 0).all()


def test_cloth_that_swings_is_resolved_as_any_other():
    V_f, body = creeping(1.1 * QUIET), held()[1]
    _, figures = resolved(V_f, body)
    assert figures.steps[KEPT] == 0
    assert (figures.steps[KEPT + 1 :] > 0).all()


def test_a_body_that_moves_is_resolved_as_any_other():
    V_f, body = held()
    body[-1, :, 1] += 1e-3
    _, figures = resolved(V_f, body)
    assert figures.steps[-2] == 0
    assert figures.steps[-1] > 0


def test_a_body_that_creeps_does_not_stand():
    V_f, body = held()
    body[:, :, 1] += np.arange(FRAMES, dtype=np.float32)[:, None] * 5e-5
    _, figures = resolved(V_f, body)
    assert (np.asarray(figures.steps)[1:] > 0).all()


def test_a_frame_with_a_nan_is_left_alone_and_forgotten():
    V_f, body = held()
    V_f[KEPT + 1, 7] = np.nan
    V, figures = resolved(V_f, body)
    assert figures.outcome[KEPT + 1] == Outcome.NOT_FINITE
    others = np.delete(np.arange(FRAMES), KEPT + 1)
    assert np.isfinite(V[others]).all()
    assert (np.asarray(figures.penetrating_after)[others] == 0).all()


def test_cloth_without_contact_comes_back_bitwise():
    V_f, body = held()
    V_f = V_f + np.float32(1.0) + np.arange(FRAMES, dtype=np.float32)[:, None, None] * np.float32(1e-4)
    V, figures = resolved(V_f, body)
    np.testing.assert_array_equal(V, V_f)
    assert (figures.outcome == Outcome.NOTHING_TO_DO).all()
