"""Writing ONNX nodes one after the other, each under a fresh name."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from onnx import AttributeProto, NodeProto, TensorProto, helper, numpy_helper

BATCH = "batch"
"""Name of the one dimension that stays free."""


class NodeWriter:
    """Nodes and constants for a graph, in an order that onnx accepts."""

    def __init__(self, prefix: str, taken: Iterable[str] = ()) -> None:
        self.nodes: list[NodeProto] = []
        self.constants: list[TensorProto] = []
        self._prefix = prefix
        self._taken = set(taken)

    def op(self, kind: str, *inputs: str, output: str | None = None, **attributes: object) -> str:
        """Append one node of operator ``kind`` and return the name of its output."""
        name = output or self._fresh(kind)
        self.nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def repeat(self, node: NodeProto, inputs: Iterable[str]) -> list[str]:
        """Append a copy of ``node`` over other inputs and return the names of its outputs."""
        names = [self._fresh(node.op_type) if output else "" for output in node.output]
        copy = helper.make_node(node.op_type, inputs, names, domain=node.domain)
        copy.attribute.extend(node.attribute)
        self.nodes.append(copy)
        return names

    def constant(self, value: npt.ArrayLike, dtype: npt.DTypeLike = np.float32) -> str:
        """Store a constant and return its name."""
        name = self._fresh("constant")
        self.constants.append(numpy_helper.from_array(np.array(value, dtype), name))
        return name

    def _fresh(self, kind: str) -> str:
        number = len(self._taken)
        while (name := f"{self._prefix}/{kind}_{number}") in self._taken:
            number += 1
        self._taken.add(name)
        return name


def attribute(node: NodeProto, name: str, default: object = None) -> object:
    """The value of a node's attribute, or ``default`` where the node does not set it."""
    found: list[AttributeProto] = [entry for entry in node.attribute if entry.name == name]
    return helper.get_attribute_value(found[0]) if found else default
