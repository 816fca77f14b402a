import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax.body.motion_features import feature_names, root_velocity_at
from garment_jax.body.root_frame import yaw_matrix
from garment_jax.model.motion.network import (
    BEYOND,
    MotionCarry,
    carry_over,
    clamped,
    gates_of,
    gru_step,
    motion_gates,
    normalise_motion,
)
from garment_jax.structs import FrameInput
from tests.reference.motion_window import frozen, motion_params, one_frame
from tests.reference.small_model import MOTION, small_model

BLIND = dataclasses.replace(MOTION, previous_state=False)


def test_the_gru_is_pytorchs_cell_with_the_same_weights():
    fixture = np.load(Path(__file__).with_name("gru_fixture.npz"))
    params = {"gru_h": {"kernel": fixture["weight_hh"].T, "bias": fixture["bias_hh"]}}
    params = jax.tree.map(jnp.asarray, params)
    step = jax.jit(gru_step)
    h = jnp.asarray(fixture["states"][0])
    for x, expected in zip(fixture["x"], fixture["states"][1:], strict=True):
        h = step(params, h, jnp.asarray(x @ fixture["weight_ih"].T + fixture["bias_ih"]))
        np.testing.assert_allclose(h, expected, atol=2e-6)


def test_a_closed_update_gate_keeps_the_state_and_an_open_one_replaces_it():
    k = 3
    params = {"gru_h": {"kernel": jnp.zeros((k, 3 * k)), "bias": jnp.zeros(3 * k)}}
    h, candidate = jnp.array([0.5, -0.5, 0.1]), jnp.array([0.3, 0.2, -2.0])
    for gate, expected in ((50.0, h), (-50.0, jnp.tanh(candidate))):
        gates = jnp.concatenate([jnp.zeros(k), jnp.full(k, gate), candidate])
        np.testing.assert_allclose(gru_step(params, h, gates), expected, atol=1e-6)


def test_carry_over_is_a_row_vector_times_turn_plus_shift():
    rng = np.random.default_rng(0)
    V, turn, shift = rng.normal(size=(2, 5, 3)), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3))
    x = FrameInput(jnp.zeros((2, 1)), *(jnp.asarray(a, jnp.float32) for a in (turn, shift)))
    out = carry_over(jnp.asarray(V, jnp.float32), x)
    for lane in range(2):
        for i in range(5):
            expected = [sum(V[lane, i, a] * turn[lane, a, b] for a in range(3)) for b in range(3)]
            np.testing.assert_allclose(out[lane, i], expected + shift[lane], atol=1e-5)


def test_a_frame_inside_the_training_range_is_held_back_by_nothing_bitwise():
    model = small_model()
    x = jax.tree.map(jnp.asarray, model.input.x)
    held = clamped(x, model.template)
    for a, b in zip(jax.tree.leaves(held), jax.tree.leaves(x), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_body_that_jumps_or_spins_leaves_the_cloth_no_farther_behind_than_in_training():
    model, fps, at = small_model(), 30.0, root_velocity_at(small_model().input.x.M.shape[1])
    names = feature_names(("LeftUpLeg", "RightUpLeg"))
    assert (names[at], names[at + 3]) == ("root velocity x m/s", "root yaw rate rad/s")
    s = model.template.statistics
    spare = BEYOND * (s.motion_high - s.motion_low)
    most = (np.maximum(-s.motion_low, s.motion_high) + spare)[at : at + 4]
    yaw, walk = np.array([0.0, 2.0, -1.5]), np.array([5.0, -0.001, 2.0])  # rad, m in the last of the frames
    M = np.tile(s.motion_mean, (3, 1))
    M[:, at : at + 3] = fps * walk
    M[:, at + 3] = fps * yaw
    x = FrameInput(*(jnp.asarray(a, jnp.float32) for a in (M, yaw_matrix(yaw), np.tile(-walk, (3, 1)))))
    held = clamped(x, model.template)
    np.testing.assert_array_equal(held.M, x.M)
    np.testing.assert_allclose(held.shift[1], -np.clip(walk, -most[:3] / fps, most[:3] / fps), rtol=1e-5)
    np.testing.assert_array_equal(held.shift[1, 1], x.shift[1, 1])  # slow enough along this axis
    turns = np.clip(yaw, -most[3] / fps, most[3] / fps)
    assert np.abs(turns).max() < 1.0
    np.testing.assert_allclose(held.turn, yaw_matrix(turns), atol=1e-6)
    half = FrameInput(x.M.at[1, at + 3].set(fps * np.pi), x.turn.at[1].set(np.diag([-1.0, 1, -1])), x.shift)
    assert np.isfinite(clamped(half, model.template).turn).all()


def test_motion_is_normalised_by_the_training_set():
    model = small_model()
    statistics = model.template.statistics
    M = model.input.x.M
    x = normalise_motion(jnp.asarray(M), model.template)
    expected = (M - statistics.motion_mean) / statistics.motion_std
    np.testing.assert_allclose(x, np.clip(expected, -10, 10), atol=1e-4)


def test_motion_far_outside_the_training_range_counts_as_just_outside_it():
    model = small_model()
    s = model.template.statistics
    width = s.motion_high - s.motion_low
    near = np.minimum(s.motion_high + BEYOND * width, s.motion_mean + 10 * s.motion_std)
    for far in (1.0, 100.0):
        x = normalise_motion(jnp.asarray(s.motion_high + far * width + far), model.template)
        np.testing.assert_allclose(x, (near - s.motion_mean) / s.motion_std, rtol=1e-4, atol=1e-4)
    spike = s._replace(motion_high=s.motion_mean + 100, motion_low=s.motion_mean)
    x = normalise_motion(jnp.asarray(s.motion_mean + 50), model.template._replace(statistics=spike))
    np.testing.assert_array_equal(x, 10.0)


def test_gates_of_a_chunk_are_those_of_its_frames():
    model, params = small_model(), motion_params()
    M = jnp.asarray(model.input.x.M[:6])
    together = jax.jit(lambda M: motion_gates(params, M, template=model.template))(M)
    x = np.asarray(normalise_motion(M, model.template))
    weights = jax.tree.map(np.asarray, params)
    hidden = x @ weights["dense"]["kernel"] + weights["dense"]["bias"]
    hidden = np.where(hidden < 0, 0.2 * hidden, hidden)
    np.testing.assert_allclose(
        together, hidden @ weights["gru_x"]["kernel"] + weights["gru_x"]["bias"], atol=1e-5
    )
    np.testing.assert_allclose(gates_of(params, jnp.asarray(x[2])), together[2], atol=1e-5)


def frame_code(V_prev: np.ndarray, config=MOTION) -> np.ndarray:
    model = small_model()
    x = jax.tree.map(jnp.asarray, model.input.frame(3))
    carry = MotionCarry(jnp.zeros(config.gru), jnp.asarray(V_prev))
    return np.asarray(one_frame(motion_params(config), frozen()[0], carry, x, config)[1])


def test_the_last_frame_matters_with_E_s_and_is_not_read_without():
    V = small_model().V[2]
    assert np.abs(frame_code(V) - frame_code(V + np.float32(0.05))).max() > 1e-3
    assert "E_s" not in motion_params(BLIND)
    blind = frame_code(V, BLIND)
    assert np.isfinite(blind).all()
    np.testing.assert_array_equal(frame_code(np.full_like(V, np.nan), BLIND), blind)


@pytest.mark.parametrize("config", [MOTION, BLIND], ids=["with E_s", "without"])
def test_shapes(config):
    params = motion_params(config)
    joined = config.gru + (config.state_dim if config.previous_state else 0)
    assert params["fc"]["kernel"].shape == (joined, 8)
    assert params["gru_h"]["kernel"].shape == (config.gru, 3 * config.gru)
    assert params["gru_x"]["bias"].shape == params["gru_h"]["bias"].shape == (3 * config.gru,)
