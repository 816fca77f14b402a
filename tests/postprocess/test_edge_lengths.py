"""Edges come back to their lengths, the short ones as folds, in small steps, and nothing else moves."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.geometry.elastic import ElasticTables
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.topology import unique_edges
from garment_jax.postprocess.edge_lengths import (
    FARTHEST,
    STEPS,
    LengthState,
    init_lengths,
    make_length_tables,
    restore_lengths,
)
from tests.postprocess.sheets import EDGE, FACES, SIDE, T

PINS = np.arange(SIDE, dtype=np.int32)  # one border

EDGES = unique_edges(FACES)
FREE = jnp.ones(len(T), bool).at[PINS].set(False)


@lru_cache
def tables() -> ElasticTables:
    made = make_length_tables(T, uniform_table(FACES, len(T)))
    assert made is not None
    return made


@lru_cache
def one():
    return jax.jit(lambda V, state: restore_lengths(state, V, free=FREE, tables=tables()))


def shortening(V: np.ndarray) -> float:
    """Return by how much edges are too short in the mean, as a part of their length."""
    length, rest = (np.linalg.norm(x[EDGES[:, 0]] - x[EDGES[:, 1]], axis=1) for x in (V, T))
    return float(np.maximum(1 - length / rest, 0).mean())


def blurred(depth: float = 0.004) -> np.ndarray:
    """Return a sheet pushed together by 10 % along z, over a hint of four folds."""
    V = T * np.array([1.0, 1.0, 0.9])
    V[:, 1] = depth * np.sin(2 * np.pi * T[:, 2] / (0.25 * EDGE * SIDE))
    return V.astype(np.float32)


def settled(V: np.ndarray, frames: int = 40) -> np.ndarray:
    return restored(init_lengths(len(T)), np.stack([V] * frames))[1]


def restored(state: LengthState, V: np.ndarray) -> tuple[LengthState, np.ndarray]:
    """Restore frames one after the other."""
    state, out = scanned()(state, jnp.asarray(V))
    return state, np.asarray(out)


@lru_cache
def scanned():
    def frame(state: LengthState, v: jax.Array):
        state, V, _ = restore_lengths(state, v, free=FREE, tables=tables())
        return state, V

    return jax.jit(lambda state, V: jax.lax.scan(frame, state, V))


def test_cloth_that_lacks_length_folds_where_the_prediction_hints_at_it():
    V = blurred()
    out = settled(V)[-1]
    assert shortening(V) > 0.04
    assert shortening(out) < 0.65 * shortening(V)
    moved = out - V
    far = T[:, 0] > 0.1  # away from the pins
    hint = V[far, 1]
    assert np.corrcoef(out[far, 1], hint)[0, 1] > 0.8
    assert np.abs(out[far, 1]).max() > 1.5 * np.abs(hint).max()
    assert np.abs(moved[far].mean(axis=0)).max() < 1e-3  # folds go both ways: nothing drifts


def test_pins_stay_and_cloth_of_its_lengths_moves_nowhere():
    out = settled(blurred())
    np.testing.assert_array_equal(out[:, PINS], np.stack([blurred()[PINS]] * len(out)))
    state, found, steps = one()(jnp.asarray(T), init_lengths(len(T)))
    np.testing.assert_allclose(found, T, atol=2e-7)
    assert steps == 1
    assert jnp.abs(state.x).max() < 2e-7


def test_cloth_that_is_stretched_beside_its_pins_is_drawn_together():
    V = T.copy()
    V[SIDE:, 0] += 0.4 * EDGE  # all but the pins, away from them
    out = settled(V)[-1]
    down = np.linalg.norm(out[SIDE : 2 * SIDE] - out[:SIDE], axis=1) / EDGE
    assert down.max() < 1.2
    length, before = (np.linalg.norm(v[EDGES[:, 0]] - v[EDGES[:, 1]], axis=1) for v in (out, V))
    assert length.max() < before.max()
    np.testing.assert_allclose(out[-SIDE:], V[-SIDE:], atol=2e-3)  # what is broad is the networks' matter


def test_a_frame_goes_on_from_the_last_and_a_chunk_from_the_last_chunk():
    frames = jnp.asarray(np.stack([blurred(0.002 + 1e-4 * k) for k in range(12)]))
    at_once = restored(init_lengths(len(T)), frames)[1]
    state, first = restored(init_lengths(len(T)), frames[:6])
    np.testing.assert_allclose(np.concatenate([first, restored(state, frames[6:])[1]]), at_once, atol=1e-7)
    state, by_hand = init_lengths(len(T)), []
    for V in frames:
        state, V, steps = one()(V, state)
        assert steps <= STEPS
        by_hand.append(V)
    np.testing.assert_allclose(jnp.stack(by_hand), at_once, atol=1e-6)


def test_a_fold_that_is_not_needed_any_more_does_not_stretch_the_cloth():
    folded = init_lengths(len(T))
    for _ in range(40):
        folded = one()(jnp.asarray(blurred()), folded)[0]
    assert jnp.abs(folded.x).max() > 2e-3
    far = (T[EDGES, 0] > 0.1).all(axis=1)  # beside the pins stretched cloth is drawn together
    rest = np.linalg.norm(T[EDGES[:, 0]] - T[EDGES[:, 1]], axis=1)
    for pull in (1.0, 1.25):  # at its length, and stretched
        V = jnp.asarray(T * np.float32([1.0, 1.0, pull]))
        state, out, _ = one()(V, folded)
        for _ in range(20):
            state, out, _ = one()(V, state)
        length, before = (np.linalg.norm(v[EDGES[:, 0]] - v[EDGES[:, 1]], axis=1) for v in np.stack([out, V]))
        assert np.percentile((length / np.maximum(before, rest))[far], 99) < 1.02


def test_what_makes_no_sense_is_soon_forgotten():
    V = jnp.asarray(blurred())
    state, _, _ = one()(1e8 * V, init_lengths(len(T)))
    assert jnp.abs(state.x).max() <= FARTHEST
    assert jnp.abs(state.ahead).max() <= FARTHEST


def test_a_broken_frame_comes_back_and_is_forgotten():
    V = jnp.asarray(blurred())
    state, _, _ = one()(V, init_lengths(len(T)))
    broken = V.at[5, 1].set(jnp.nan)
    after, out, steps = one()(broken, state)
    np.testing.assert_array_equal(out, broken)
    jax.tree.map(np.testing.assert_array_equal, after, state)
    assert steps == 0


def test_points_without_edges_have_no_lengths_to_restore():
    assert make_length_tables(T[:4], uniform_table(np.zeros((0, 3), np.int32), 4)) is None


def test_a_crushed_fold_hardly_magnifies_a_rounding():
    V = T.copy()  # flat: which way it buckles is chance
    V[:, 2] = np.interp(
        T[:, 2], [0.0, 0.2, 0.3, 0.46], [0.0, 0.2, 0.235, 0.395]
    )  # a third is left of a stripe
    noise = 1e-7 * np.random.default_rng(0).standard_normal(V.shape).astype(np.float32)
    apart = np.abs(settled(V, 30) - settled(V + noise, 30))
    assert apart.max() < 50 * np.abs(noise).max()  # ten thousand with the whole force of crushed edges


@pytest.mark.parametrize("scale", [0.0, 1e-30, 100.0])
def test_crushed_and_blown_up_cloth_stays_finite(scale):
    out = settled((scale * T).astype(np.float32), 5)
    assert np.isfinite(out).all()


def test_cloth_that_lacks_much_makes_broad_folds_not_fine_ripples():
    """A third is missing. Without the last frame's momentum most of it goes into waves of 8 cm."""
    V = T * np.array([1.0, 1.0, 0.7])
    V[:, 1] = 0.002 * np.random.default_rng(0).standard_normal(len(T))
    out = settled(V.astype(np.float32), 60)[-1]
    assert shortening(out) < 0.6 * shortening(V)
    line = out.reshape(SIDE, SIDE, 3)[SIDE // 2 :, :, 1]  # heights along z, far from the pins
    power = np.square(np.abs(np.fft.rfft(line - line.mean(axis=1, keepdims=True), axis=1))).sum(axis=0)
    broad = np.arange(len(power)) < EDGE * SIDE / 0.11  # waves of more than 11 cm
    assert power[broad].sum() > 0.6 * power.sum()
