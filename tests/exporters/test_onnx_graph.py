"""JAX functions as ONNX graphs: each operator against JAX in onnxruntime, what folds, what is refused."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs the extra onnx")
pytest.importorskip("onnxruntime", reason="needs the extra onnx")

from garment_jax.exporters.onnx_check import open_graph  # noqa: E402
from garment_jax.exporters.onnx_graph import OPSETS, Port, to_onnx  # noqa: E402
from garment_jax.geometry.stencil import apply_stencil, make_stencil  # noqa: E402
from garment_jax.model.generative.blocks import leaky  # noqa: E402
from garment_jax.model.generative.convolution import down_convolution, up_convolution  # noqa: E402

RNG = np.random.default_rng(3)
KERNEL = RNG.normal(size=(4, 4, 3, 5)).astype(np.float32)
PHASES = RNG.normal(size=(2, 2, 3, 8)).astype(np.float32)
TABLE = make_stencil(RNG.integers(0, 6, (9, 4)), RNG.random((9, 4)), 6)
FUNCTIONS: dict[str, tuple[Callable, tuple[int, ...]]] = {
    "arithmetic": (lambda x: jnp.tanh(x) - 2.0 * x / (1.0 + jnp.square(x)), (3, 4)),
    "leaky": (leaky, (5,)),
    "clip": (lambda x: jnp.clip(x, -0.5, 0.25), (7,)),
    "roots": (lambda x: jnp.sqrt(x**2 + 1.0) + jax.lax.rsqrt(x**2 + 2.0), (3, 2)),
    "integer power": (lambda x: x**3, (4,)),
    "gates": (lambda x: jax.nn.sigmoid(jnp.split(x, 3)[1]) * jnp.arctan(jnp.split(x, 3)[2]), (9,)),
    "slices": (lambda x: jnp.concatenate([x[1:3, ::2], x[:2, 1:3]], axis=1), (4, 5)),
    "stack": (lambda x: jnp.stack([x, 2.0 * x, -x], axis=1).reshape(3, -1), (2, 3)),
    "mean": (lambda x: (x - x.mean(axis=(0, 1), keepdims=True)).sum(axis=-1), (3, 4, 2)),
    "dot": (lambda x: jnp.tensordot(KERNEL[0], x, ((1,), (2,))), (2, 3, 3, 2)),
    "batches of matrices": (lambda x: jnp.einsum("abij,bkj->abki", x, x[1]), (2, 3, 4, 5)),
    "largest": (lambda x: x.max(axis=(0, 2)), (3, 4, 2)),
    "both": (lambda x: jnp.where((x > -0.5) & (x <= 0.5), x, 0.0), (9,)),
    "row times matrix": (lambda x: x @ KERNEL[0, 0], (3,)),
    "broadcast": (lambda x: jnp.broadcast_to(x[:, None], (3, 4)) + jnp.broadcast_to(x, (4, 3)).T, (3,)),
    "take": (lambda x: jnp.take(x, TABLE.index, axis=-1, mode="clip"), (2, 3, 6)),
    "out of range": (lambda x: jnp.take(x, np.array([-3, 0, 9]), axis=0, mode="clip"), (4, 2)),
    "stencil": (lambda x: apply_stencil(x, TABLE), (6, 3)),
    "down": (lambda x: down_convolution(x, jnp.asarray(KERNEL)), (6, 6, 3)),
    "up": (lambda x: up_convolution(x, jnp.asarray(PHASES)), (3, 5, 3)),
}


def exported(function: Callable, shape: tuple[int, ...], opset: int = 17):
    port = Port("x", shape, "any numbers")
    return to_onnx(lambda x: [function(x)], [port], [("y", "of x")], name="f", opset=opset, metadata={})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_and_its_graph_give_the_same_numbers(name: str):
    function, shape = FUNCTIONS[name]
    x = RNG.normal(size=shape).astype(np.float32)
    model = exported(function, shape)
    (y,) = open_graph(model.SerializeToString()).run(["y"], {"x": x})
    np.testing.assert_allclose(y, jax.jit(function)(x), rtol=1e-5, atol=1e-6)
    assert {node.domain for node in model.graph.node} == {""}


@pytest.mark.parametrize("opset", OPSETS)
def test_the_first_and_the_last_operator_set_load_and_agree(opset: int):
    x = RNG.normal(size=(6, 6, 3)).astype(np.float32)

    def function(x):
        return leaky(down_convolution(x, jnp.asarray(KERNEL))).sum(axis=0).max(axis=-1)

    model = exported(function, x.shape, opset)
    assert [(o.domain, o.version) for o in model.opset_import] == [("", opset)]
    (y,) = open_graph(model.SerializeToString()).run(["y"], {"x": x})
    np.testing.assert_allclose(y, jax.jit(function)(x), rtol=1e-5, atol=1e-5)


def test_what_hangs_on_no_input_is_computed_once_and_stored_once():
    A = jnp.asarray(KERNEL[0, 0])
    model = exported(lambda x: (x @ jnp.sin(A) + (x + 1.0) @ jnp.sin(A)) + 0.0 * jnp.sin(A).sum(), (3,))
    stored = [tuple(t.dims) for t in model.graph.initializer]
    assert stored.count((3, 5)) == 1
    assert "Sin" not in {node.op_type for node in model.graph.node}


def test_nodes_that_no_output_needs_are_left_out():
    model = exported(lambda x: (jnp.exp(x), x + 1.0)[1], (3,))
    assert {node.op_type for node in model.graph.node} == {"Add", "Identity"}


@pytest.mark.parametrize(
    ("function", "sentence"),
    [
        (jnp.sort, "JAX operation 'sort', which has no ONNX operator"),
        (lambda x: jnp.take(x, x[0].astype(int), axis=0), "rewrite it"),
    ],
)
def test_what_is_not_written_is_refused_by_name(function: Callable, sentence: str):
    with pytest.raises(ValueError, match=sentence):
        exported(function, (2, 2, 2))


@pytest.mark.parametrize("opset", [7, 99])
def test_an_operator_set_out_of_range_is_refused(opset: int):
    with pytest.raises(ValueError, match=f"opset={opset} is not supported; choose 17 to 21"):
        exported(jnp.tanh, (2,), opset)
