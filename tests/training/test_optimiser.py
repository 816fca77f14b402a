"""The optimisers against their published update rules, written as NumPy loops."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.config import TrainingConfig
from garment_jax.training.optimiser import make_optimiser, make_schedule, rate_at

RATE, DECAY, STEPS = 0.1, 0.05, 6
GRADIENTS = np.random.default_rng(0).normal(size=(STEPS, 4)).astype(np.float32)
START = np.array([1.0, -2.0, 0.5, 3.0], np.float32)


def numpy_adam(*, l2: float, decoupled: float) -> np.ndarray:
    """Adam as in Kingma and Ba; l2 is added to the gradient, decoupled shrinks the parameter."""
    p, m, v = START.astype(np.float64), np.zeros(4), np.zeros(4)
    for t, gradient in enumerate(GRADIENTS.astype(np.float64), start=1):
        g = gradient + l2 * p
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g**2
        m_hat, v_hat = m / (1 - 0.9**t), v / (1 - 0.999**t)
        p = p - RATE * decoupled * p - RATE * m_hat / (np.sqrt(v_hat) + 1e-8)
    return p


def run(name: str, *, clip_norm: float = 0.0, gradients: np.ndarray = GRADIENTS) -> np.ndarray:
    config = TrainingConfig(optimiser=name, clip_norm=clip_norm, schedule="constant", warmup=0.0)  # type: ignore
    optimiser = make_optimiser(config, learning_rate=RATE, weight_decay=DECAY, steps=STEPS)
    p = jnp.asarray(START)
    state = optimiser.init(p)
    for gradient in gradients:
        updates, state = optimiser.update(jnp.asarray(gradient), state, p)
        p = optax.apply_updates(p, updates)
    return np.asarray(p)


def test_adamw_shrinks_the_parameter_apart_from_the_gradient() -> None:
    np.testing.assert_allclose(run("adamw"), numpy_adam(l2=0.0, decoupled=DECAY), rtol=1e-5)


def test_adam_l2_adds_the_decay_to_the_gradient() -> None:
    np.testing.assert_allclose(run("adam_l2"), numpy_adam(l2=DECAY, decoupled=0.0), rtol=1e-5)


def test_the_two_decays_differ() -> None:
    assert np.abs(run("adamw") - run("adam_l2")).max() > 1e-3


def test_clipping_comes_before_the_decay_is_added() -> None:
    # A gradient of zero stays zero when clipped, and L2 decay alone then moves the parameter.
    moved = run("adam_l2", clip_norm=1e-3, gradients=np.zeros((1, 4), np.float32))
    np.testing.assert_allclose(moved, START - RATE * np.sign(START), rtol=1e-5)


def test_clipping_limits_the_global_norm() -> None:
    config = TrainingConfig(clip_norm=1.0, schedule="constant", warmup=0.0)
    optimiser = make_optimiser(config, learning_rate=RATE, weight_decay=0.0, steps=1)
    p = {"a": jnp.zeros(2), "b": jnp.zeros(2)}
    _, big = optimiser.update({"a": jnp.full(2, 30.0), "b": jnp.full(2, 40.0)}, optimiser.init(p), p)
    # First moment = 0.1 x clipped gradient, and (30, 30, 40, 40) has the norm 50 sqrt(2).
    first = optax.tree.get(big, "mu")
    np.testing.assert_allclose(first["a"], 0.1 * 30 / (50 * np.sqrt(2)) * np.ones(2), rtol=1e-5)


def rates(config: TrainingConfig, *, learning_rate: float, steps: int, count: int) -> np.ndarray:
    schedule = make_schedule(config, learning_rate=learning_rate, steps=steps)
    return np.array([float(rate_at(config, schedule._replace(count=jnp.int32(k)))) for k in range(count)])


@pytest.mark.parametrize(("schedule", "last"), [("constant", 0.1), ("cosine", 0.001)])
def test_schedule_rises_then_ends_at_the_final_rate(schedule: str, last: float) -> None:
    config = TrainingConfig(schedule=schedule, warmup=0.1, final_rate=0.01)  # type: ignore[arg-type]
    rate = rates(config, learning_rate=0.1, steps=100, count=101)
    np.testing.assert_allclose(rate[0], 0.01, rtol=1e-6)  # a tenth of the rise, not zero
    np.testing.assert_allclose(rate[9], 0.1, rtol=1e-6)
    np.testing.assert_allclose(rate[100], last, rtol=1e-4)
    assert rate[0] < rate[5] < rate[9]


def test_schedule_of_a_single_step_is_finite() -> None:
    assert rates(TrainingConfig(), learning_rate=0.1, steps=1, count=1) == pytest.approx([0.1])


@pytest.mark.parametrize("schedule", ["constant", "cosine"])
@pytest.mark.parametrize(
    ("steps", "warmup"), [(1, 0.02), (40, 0.02), (50, 0.02), (97, 0.1), (30, 0.0), (8, 1.0)]
)
def test_the_rate_of_every_step_is_that_of_optax(schedule: str, steps: int, warmup: float) -> None:
    config = TrainingConfig(schedule=schedule, warmup=warmup, final_rate=0.03)  # type: ignore[arg-type]
    rise = round(warmup * steps)
    fall = optax.cosine_decay_schedule(0.2, max(steps - rise, 1), alpha=0.03)
    expected = fall if schedule == "cosine" else optax.constant_schedule(0.2)
    if rise:
        first = optax.linear_schedule(0.2 / rise, 0.2, max(rise - 1, 1))
        expected = optax.join_schedules([first, expected], [rise])
    found = rates(config, learning_rate=0.2, steps=steps, count=steps + 3)
    np.testing.assert_allclose(found, [float(expected(k)) for k in range(steps + 3)], rtol=2e-6)


def test_other_steps_and_another_rate_are_the_same_program() -> None:
    texts = []
    for rate, steps in ((0.1, 20), (0.02, 4000)):
        optimiser = make_optimiser(TrainingConfig(), learning_rate=rate, weight_decay=DECAY, steps=steps)
        p = jnp.asarray(START)
        texts.append(jax.jit(optimiser.update).lower(p, optimiser.init(p), p).as_text())
    assert texts[0] == texts[1]


def test_every_step_takes_the_next_rate() -> None:
    config = TrainingConfig(optimiser="adamw", clip_norm=0.0, schedule="cosine", warmup=0.5)
    optimiser = make_optimiser(config, learning_rate=RATE, weight_decay=0.0, steps=STEPS)
    p = jnp.zeros(1)
    state, moved = optimiser.init(p), []
    for _ in range(STEPS):
        updates, state = optimiser.update(jnp.ones(1), state, p)
        moved.append(-float(updates[0]))  # with a constant gradient Adam's step is the rate
    expected = rates(config, learning_rate=RATE, steps=STEPS, count=STEPS)
    np.testing.assert_allclose(moved, expected, rtol=1e-4)
