"""Nodes and initialisers of an ONNX graph while it grows; what is there already is not stored again."""

from collections.abc import Sequence
from typing import Any

import numpy as np

Value = str | np.ndarray  # the name of a tensor in the graph, or a constant


class Builder:
    """Collects nodes and initialisers; equal ones are stored once."""

    def __init__(self, opset: int) -> None:
        self.opset = opset
        self.nodes: list[Any] = []
        self._stored: dict[tuple, tuple[str, np.ndarray]] = {}
        self._made: dict[tuple, str] = {}

    def node(self, operator: str, inputs: Sequence[Value], *, name: str = "", **attributes: Any) -> str:
        """Return the name of a node's one result; an unnamed node that is there already is not repeated."""
        read = [self.named(x) for x in inputs]
        key = (operator, *read, repr(attributes))
        if name or key not in self._made:
            names = [name or f"t{len(self.nodes)}"]
            self._made[key] = self.node_of_many(operator, read, names, **attributes)[0]
        return self._made[key]

    def node_of_many(self, operator: str, inputs: Sequence[Value], names: list[str], **attributes: Any):
        """Add a node whose results are `names`; return them."""
        from onnx import helper

        title = f"{operator}_{len(self.nodes)}"
        read = [self.named(x) for x in inputs]
        self.nodes.append(helper.make_node(operator, read, names, name=title, **attributes))
        return names

    def named(self, x: Value) -> str:
        """Return the name of `x`, stored first if it is a constant."""
        if isinstance(x, str):
            return x
        x = np.ascontiguousarray(x).reshape(x.shape)
        key = (x.dtype.str, x.shape, x.tobytes())
        return self._stored.setdefault(key, (f"c{len(self._stored)}", x))[0]

    def reachable(self, outputs: Sequence[str]) -> tuple[list[Any], list[Any]]:
        """Return the nodes and initialisers that `outputs` hang on, in order."""
        from onnx import numpy_helper

        wanted, kept = set(outputs), []
        for node in reversed(self.nodes):
            if wanted & set(node.output):
                kept.append(node)
                wanted |= set(node.input)
        stored = [numpy_helper.from_array(x, name) for name, x in self._stored.values() if name in wanted]
        return kept[::-1], stored
