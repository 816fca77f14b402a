import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.core import Tracer

from garment_jax.geometry.noinline import fusion_barrier, noinline

on_a_cpu = pytest.mark.skipif(jax.default_backend() != "cpu", reason="what XLA does on a CPU")


def calls(f, *args) -> int:
    return jax.jit(f).lower(*args).compile().as_text().count(" call(")


@pytest.mark.parametrize("first", [1.5, -0.0, np.nan, np.inf])
def test_what_is_materialised_keeps_every_bit(first):
    x = np.array([first, -0.0, 1e-40, -np.inf, np.nan, 3.0], np.float32)
    found = np.asarray(jax.jit(fusion_barrier)(jnp.asarray(x)))
    np.testing.assert_array_equal(found.view(np.int32) | np.isnan(x), x.view(np.int32) | np.isnan(x))


@pytest.mark.parametrize("first", [7, -8, np.iinfo(np.int32).min, np.iinfo(np.int32).max])
def test_so_do_integers_and_what_comes_beside_them(first):
    x = np.array([first, 0, -1, np.iinfo(np.int32).min, 5], np.int32)
    y = np.array([[np.nan, 2.0]], np.float32)
    found = jax.jit(fusion_barrier)((jnp.asarray(x), {"y": jnp.asarray(y)}))
    np.testing.assert_array_equal(found[0], x)
    np.testing.assert_array_equal(found[1]["y"], y)


def test_what_is_empty_comes_back():
    empty, one = jnp.zeros((0, 3)), jnp.ones(2)
    assert fusion_barrier(empty).shape == (0, 3)
    found = fusion_barrier((empty, one))
    assert found[0].shape == (0, 3)
    np.testing.assert_array_equal(found[1], one)


def test_the_gradient_of_what_is_materialised():
    x = jnp.asarray([0.3, -2.0], jnp.float32)
    for start in (0.0, np.nan):
        loss = lambda x: (fusion_barrier(jnp.concatenate([jnp.array([start]), 3 * x**2]))[1:]).sum()  # noqa: B023, E731
        np.testing.assert_allclose(jax.jit(jax.grad(loss))(x), 6 * x)


@on_a_cpu
def test_it_is_a_call_when_compiled():
    for x in (jnp.ones((3, 200)), jnp.ones(64, jnp.int32)):
        assert calls(lambda x: fusion_barrier(x + x) * 2, x) == 1


@noinline
def wave(x, scale=1.0, *, table=None, rows=None):
    y = jnp.where(x > 0, jnp.sin(scale * x), jnp.clip(x, -1.0, 1.0))
    if table is not None:
        y = y + jnp.asarray(table)[0]
    return {"y": y, "first": y[: rows or 1]}


def test_a_function_apart_gives_what_it_gives_by_itself():
    x, table = jnp.linspace(-2.0, 2.0, 7), np.arange(3, dtype=np.float32)
    alone = wave(x, 2.0, table=table, rows=3)
    for scale in (2.0, jnp.asarray(2.0)):
        within = jax.jit(lambda x, scale=scale: wave(x, scale, table=table, rows=3))(x)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), within, alone)
    assert within["first"].shape == (3,)


@on_a_cpu
def test_what_it_calls_is_its_own_and_no_call_of_its_own():
    x = jnp.linspace(-2.0, 2.0, 7)
    assert calls(lambda x: wave(x)["y"], x) == 1  # of `jnp.where` and `jnp.clip` none
    assert calls(lambda x: noinline(lambda z: wave(z)["y"] + wave(-z)["y"])(x), x) == 3


def test_without_a_trace_it_is_called_as_it_is():
    seen = []
    noinline(lambda x, y: seen.append((x, y)))(jnp.ones(2), 3)
    assert not isinstance(seen[0][0], Tracer)
    assert seen[0][1] == 3


@on_a_cpu
def test_calls_alike_are_traced_once_and_others_each():
    traced = []

    @noinline
    def scaled(x, by, table):
        traced.append(by)
        return x * by + jnp.asarray(table)

    @noinline
    def outer(x):
        one, other, rows = np.float32([1.0]), np.float32([1.0]), [(0.0, 1), (-0.0, 1), (0.0, 1), (1, 1)]
        made = [scaled(x, by, one) for by, _ in rows]
        return [*made, scaled(x, 0.0, other), scaled(jnp.concatenate([x, x]), 0.0, one)[:2]]

    x = jnp.asarray([-1.0, 2.0])
    for times in (1, 2):  # a second program shares nothing with the first
        found = jax.jit(lambda x: outer(x))(x)
        assert [str(by) for by in traced] == times * ["0.0", "-0.0", "1", "0.0", "0.0"]
    np.testing.assert_array_equal(np.asarray(found)[3], x + 1)
    np.testing.assert_array_equal(np.asarray(found)[[0, 1, 2, 4, 5]], np.ones((5, 2)))


def test_its_derivatives_and_its_batches():
    f = noinline(lambda x, k: (k * x**3).sum())
    x = jnp.asarray([0.5, -1.0])
    for g in (jax.grad(f), jax.jit(jax.grad(f))):
        np.testing.assert_allclose(g(x, 2.0), 6 * x**2)
    tangent = jax.jvp(jax.jit(lambda x: f(x, 2.0)), (x,), (jnp.ones(2),))[1]
    np.testing.assert_allclose(tangent, (6 * x**2).sum(), rtol=1e-6)
    batch = jnp.stack([x, 2 * x, 3 * x])
    np.testing.assert_allclose(jax.vmap(lambda x: f(x, 2.0))(batch), [f(x, 2.0) for x in batch], rtol=1e-6)


@on_a_cpu
def test_in_a_gradient_it_stays_a_call():
    f = noinline(lambda x: jnp.sin(x) * jnp.cos(x))
    assert calls(jax.grad(lambda x: f(2 * x).sum()), jnp.ones(8)) >= 1


def test_an_error_within_is_that_error():
    @noinline
    def broken(x):
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        jax.jit(broken)(jnp.ones(2))
