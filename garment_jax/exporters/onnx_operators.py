"""JAX primitives as standard ONNX operators, one function a primitive.

Each takes (builder, inputs, their shapes, the results' shapes, the primitive's parameters) and returns the
result, or a list of results. Shapes are known: every graph is for one garment and one frame.
"""

from collections.abc import Callable, Sequence
from math import prod

import numpy as np

from garment_jax.exporters.onnx_builder import Builder, Value

Shape = tuple[int, ...]


def _integers(*values: int) -> np.ndarray:
    return np.array(values, np.int64)


def _shaped(b: Builder, x: Value, old: Shape, new: Shape) -> Value:
    if old == new:
        return x
    return x.reshape(new) if isinstance(x, np.ndarray) else b.node("Reshape", [x, _integers(*new)])


def _turned(b: Builder, x: Value, order: Sequence[int]) -> Value:
    if list(order) == list(range(len(order))):
        return x
    return x.transpose(order) if isinstance(x, np.ndarray) else b.node("Transpose", [x], perm=list(order))


def _same(operator: str) -> Callable:
    """The operator of the same meaning; ONNX broadcasts scalars and axes of length 1 as JAX does."""
    return lambda b, x, old, new, params: b.node(operator, x)


def _alias(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return x[0]


def _reshape(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return _shaped(b, x[0], old[0], new[0])


def _transpose(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return _turned(b, x[0], params["permutation"])


def _square(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return b.node("Mul", [x[0], x[0]])


def _rsqrt(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return b.node("Reciprocal", [b.node("Sqrt", x)])


def _integer_pow(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return b.node("Pow", [x[0], np.array(params["y"], np.float32)])


def _clamp(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    low, value, high = x
    return b.node("Min", [b.node("Max", [value, low]), high])


def _where(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    which, when_false, when_true = x
    return b.node("Where", [which, when_true, when_false])


def _convert(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    from onnx import helper

    return b.node("Cast", x, to=helper.np_dtype_to_tensor_dtype(np.dtype(params["new_dtype"])))


def _broadcast(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    shape, axes = new[0], params["broadcast_dimensions"]
    aligned = [1] * len(shape)
    for length, axis in zip(old[0], axes, strict=True):
        aligned[axis] = length
    y = _shaped(b, x[0], old[0], tuple(aligned))
    return y if tuple(aligned) == shape else b.node("Expand", [y, _integers(*shape)])


def _reduce_sum(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return b.node("ReduceSum", [x[0], _integers(*params["axes"])], keepdims=0)


def _reduce_max(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    axes = [int(axis) for axis in params["axes"]]  # an attribute until operator set 18, then an input
    if b.opset < 18:
        return b.node("ReduceMax", [x[0]], axes=axes, keepdims=0)
    return b.node("ReduceMax", [x[0], _integers(*axes)], keepdims=0)


def _slice(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    steps = params["strides"] or (1,) * len(old[0])
    whole = zip(params["start_indices"], params["limit_indices"], steps, old[0], strict=True)
    cut = [(axis, a, z, s) for axis, (a, z, s, n) in enumerate(whole) if (a, z, s) != (0, n, 1)]
    if not cut:
        return x[0]
    axes, begins, ends, strides = (_integers(*column) for column in zip(*cut, strict=True))
    return b.node("Slice", [x[0], begins, ends, axes, strides])


def _split(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> list[str]:
    names = [f"t{len(b.nodes)}_{i}" for i in range(len(new))]
    sizes = _integers(*(int(size) for size in params["sizes"]))
    return b.node_of_many("Split", [x[0], sizes], names, axis=int(params["axis"]))


def _concatenate(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    return b.node("Concat", x, axis=int(params["dimension"]))


def _stack(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    axis = int(params["axis"]) % len(new[0])
    one = (*new[0][:axis], 1, *new[0][axis + 1 :])
    return b.node("Concat", [_shaped(b, y, o, one) for y, o in zip(x, old, strict=True)], axis=axis)


def _gather(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    """`jnp.take` along one axis with constant indices; anything else is refused."""
    numbers, indices = params["dimension_numbers"], x[1]
    axes, rank = numbers.collapsed_slice_dims, len(old[1]) - 1
    whole = (*old[0][: axes[0]], 1, *old[0][axes[0] + 1 :]) if len(axes) == 1 else None
    places = tuple(i if i < axes[0] else i + rank for i in range(len(old[0]) - 1)) if whole else None
    if (
        not isinstance(indices, np.ndarray)
        or tuple(params["slice_sizes"]) != whole
        or tuple(numbers.offset_dims) != places
        or tuple(numbers.start_index_map) != tuple(axes)
    ):
        raise ValueError(f"the model gathers as {numbers}, which is no take along one axis; rewrite it so.")
    axis = int(axes[0])
    index = np.clip(indices[..., 0], 0, old[0][axis] - 1).astype(np.int32)
    if len(old[0]) == 2 and axis == 1 and index.ndim == 1:
        # onnxruntime copies slice by slice: rows of channels instead of single numbers, four times faster
        return _turned(b, b.node("Gather", [_turned(b, x[0], (1, 0)), index], axis=0), (1, 0))
    return b.node("Gather", [x[0], index], axis=axis)


def _dot(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    """A tensor product as one matrix product, batch axes first."""
    contracted, batch = params["dimension_numbers"]
    free = [
        [i for i in range(len(s)) if i not in (*c, *k)]
        for s, c, k in zip(old, contracted, batch, strict=True)
    ]
    orders = [*batch[0], *free[0], *contracted[0]], [*batch[1], *contracted[1], *free[1]]
    turned = [_turned(b, y, order) for y, order in zip(x, orders, strict=True)]
    shapes = [tuple(s[i] for i in order) for s, order in zip(old, orders, strict=True)]
    side = [old[0][i] for i in batch[0]]
    many = (prod(side),) if side else ()
    inner = prod(old[0][i] for i in contracted[0])
    rows, columns = (prod(s[i] for i in f) for s, f in zip(old, free, strict=True))
    product = b.node(
        "MatMul",
        [
            _shaped(b, turned[0], shapes[0], (*many, rows, inner)),
            _shaped(b, turned[1], shapes[1], (*many, inner, columns)),
        ],
    )
    return _shaped(b, product, (*many, rows, columns), new[0])


def _convolution(b: Builder, x: list[Value], old: list[Shape], new: list[Shape], params: dict) -> Value:
    numbers, padding = params["dimension_numbers"], params["padding"]
    if any(d != 1 for d in params["lhs_dilation"]) or params["batch_group_count"] != 1:
        raise ValueError("the model dilates a convolution's input, which is not written here; rewrite it.")
    y = b.node(
        "Conv",
        [_turned(b, x[0], numbers.lhs_spec), _turned(b, x[1], numbers.rhs_spec)],
        strides=list(params["window_strides"]),
        pads=[low for low, _ in padding] + [high for _, high in padding],
        dilations=list(params["rhs_dilation"]),
        group=params["feature_group_count"],
    )
    return _turned(b, y, np.argsort(numbers.out_spec).tolist())


_DIRECT = {
    "abs": "Abs",
    "add": "Add",
    "add_any": "Add",
    "and": "And",
    "atan": "Atan",
    "cos": "Cos",
    "div": "Div",
    "eq": "Equal",
    "exp": "Exp",
    "ge": "GreaterOrEqual",
    "gt": "Greater",
    "le": "LessOrEqual",
    "log": "Log",
    "logistic": "Sigmoid",
    "lt": "Less",
    "max": "Max",
    "min": "Min",
    "mul": "Mul",
    "neg": "Neg",
    "sin": "Sin",
    "sqrt": "Sqrt",
    "sub": "Sub",
    "tanh": "Tanh",
}

OPERATORS: dict[str, Callable] = {name: _same(operator) for name, operator in _DIRECT.items()} | {
    "broadcast_in_dim": _broadcast,
    "clamp": _clamp,
    "concatenate": _concatenate,
    "conv_general_dilated": _convolution,
    "convert_element_type": _convert,
    "copy": _alias,
    "copy_p": _alias,
    "dot_general": _dot,
    "expand_dims": _reshape,
    "gather": _gather,
    "integer_pow": _integer_pow,
    "reduce_max": _reduce_max,
    "reduce_sum": _reduce_sum,
    "reshape": _reshape,
    "rsqrt": _rsqrt,
    "select_n": _where,
    "slice": _slice,
    "split": _split,
    "square": _square,
    "squeeze": _reshape,
    "stack": _stack,
    "stop_gradient": _alias,
    "transpose": _transpose,
}
