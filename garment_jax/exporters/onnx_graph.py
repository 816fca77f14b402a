"""A JAX function becomes an ONNX graph of standard operators, for hosts that run ONNX but not JAX.

The function is traced once and its jaxpr walked. What hangs on no input is computed here and stored as an
initialiser. General converters exist; this one knows the few primitives of these networks
(`onnx_operators.py`), needs `onnx` alone and picks an operator set that hosts already load.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from garment_jax.exporters.onnx_builder import Builder, Value
from garment_jax.exporters.onnx_operators import OPERATORS

PRODUCER = "garment_jax"
OPSETS = (17, 21)  # lowest and highest that the operators are written for
NESTED = ("jaxpr", "call_jaxpr", "fun_jaxpr")  # under these names a primitive holds a jaxpr to inline
_IR_VERSIONS = {17: 8, 18: 8, 19: 9, 20: 9, 21: 10}  # those that the ONNX releases of these sets shipped with


class Port(NamedTuple):
    """An input or output of a graph: all are float32."""

    name: str
    shape: tuple[int, ...]
    text: str  # what it is, with its unit and frame


def to_onnx(
    function: Callable[..., Sequence[Any]],
    inputs: Sequence[Port],
    outputs: Sequence[tuple[str, str]],
    *,
    name: str,
    opset: int,
    metadata: dict[str, str],
) -> Any:
    """Return the `onnx.ModelProto` of `function`, which takes `inputs` and returns `outputs` (name, text).

    Raises `ValueError` for a primitive that has no operator here, or an operator set out of range.
    """
    import onnx
    from onnx import TensorProto, helper

    check_opset(opset)
    closed = jax.make_jaxpr(function)(*(jax.ShapeDtypeStruct(p.shape, jnp.float32) for p in inputs))
    builder = Builder(opset)
    results = _walk(builder, closed, [p.name for p in inputs])
    names = [builder.node("Identity", [x], name=y) for x, (y, _) in zip(results, outputs, strict=True)]
    nodes, initialisers = builder.reachable(names)
    texts = {p.name: p.text for p in inputs} | dict(outputs)
    float32 = TensorProto.FLOAT
    graph = helper.make_graph(
        nodes,
        name,
        [helper.make_tensor_value_info(p.name, float32, p.shape, texts[p.name]) for p in inputs],
        [
            helper.make_tensor_value_info(y, float32, v.aval.shape, texts[y])  # type: ignore[attr-defined]
            for y, v in zip(names, closed.jaxpr.outvars, strict=True)
        ],
        initialisers,
    )
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", opset)],
        ir_version=_IR_VERSIONS[opset],
        producer_name=PRODUCER,
    )
    helper.set_model_props(model, metadata)
    onnx.checker.check_model(model, full_check=True)
    return model


def check_opset(opset: int) -> None:
    """Raise `ValueError` for an operator set that is not written here."""
    low, high = OPSETS
    if not low <= opset <= high:
        raise ValueError(f"opset={opset} is not supported; choose {low} to {high} ({low} loads everywhere).")


def _walk(builder: Builder, closed: Any, inputs: Sequence[Value]) -> list[Value]:
    """Emit the nodes of a jaxpr; return the values of its results."""
    known: dict[Any, Value] = dict(zip(closed.jaxpr.invars, inputs, strict=True))
    known |= {v: np.asarray(x) for v, x in zip(closed.jaxpr.constvars, closed.consts, strict=True)}

    def read(v: Any) -> Value:
        return np.asarray(v.val) if isinstance(v, Literal) else known[v]

    for equation in closed.jaxpr.eqns:
        values = _apply(builder, equation, [read(v) for v in equation.invars])
        known |= dict(zip(equation.outvars, values, strict=True))
    return [read(v) for v in closed.jaxpr.outvars]


def _apply(builder: Builder, equation: Any, inputs: list[Value]) -> list[Value]:
    """Return the values of one equation: inlined, computed here, or as nodes."""
    name, params = equation.primitive.name, equation.params
    if name == "platform_index":  # `jax.lax.platform_dependent`: the last is the one for any other platform
        return [np.asarray(len(params["platforms"]) - 1)]
    if name == "cond" and isinstance(inputs[0], np.ndarray):
        return _walk(builder, params["branches"][int(inputs[0])], inputs[1:])
    if params.get("name") == "leaky_relu" and len(inputs) == 2 and not isinstance(inputs[1], str):
        return [builder.node("LeakyRelu", inputs[:1], alpha=float(inputs[1]))]  # else three nodes
    for key in NESTED:
        if hasattr(params.get(key), "consts"):  # a closed jaxpr, which some versions of JAX call a jaxpr
            return _walk(builder, params[key], inputs)
    if all(isinstance(x, np.ndarray) for x in inputs):
        out = equation.primitive.bind(*(jnp.asarray(x) for x in inputs), **params)
        return [np.asarray(x) for x in (out if equation.primitive.multiple_results else [out])]
    if name not in OPERATORS:
        raise ValueError(
            f"the model uses the JAX operation {name!r}, which has no ONNX operator here; add it to "
            "garment_jax/exporters/onnx_operators.py."
        )
    shapes = [tuple(v.aval.shape) for v in equation.invars], [tuple(v.aval.shape) for v in equation.outvars]
    out = OPERATORS[name](builder, inputs, *shapes, params)
    return list(out) if isinstance(out, list) else [out]
