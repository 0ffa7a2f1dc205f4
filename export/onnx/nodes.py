"""Nodes of ONNX graphs: written one after the other, each under a fresh name, and what they read."""

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt
from onnx import AttributeProto, GraphProto, NodeProto, TensorProto, helper, numpy_helper

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


def subgraphs(node: NodeProto) -> Iterator[GraphProto]:
    """The branches or the body of a node of control flow; of other nodes nothing."""
    for entry in node.attribute:
        if entry.HasField("g"):
            yield entry.g
        yield from entry.graphs


def reads(node: NodeProto) -> set[str]:
    """Names of the tensors that a node depends on, with those that only its branches or its body read."""
    names = {name for name in node.input if name}
    for graph in subgraphs(node):
        within = {value.name for value in (*graph.input, *graph.initializer)}
        for inner in graph.node:
            names |= reads(inner) - within
            within |= set(inner.output)
        names |= {value.name for value in graph.output} - within
    return names


def needed(nodes: Iterable[NodeProto], outputs: Iterable[str]) -> list[NodeProto]:
    """Those of the nodes, in their order, that lead to the outputs."""
    names, kept = set(outputs), []
    for node in reversed(list(nodes)):
        if not names.isdisjoint(node.output):
            names |= reads(node)
            kept.append(node)
    return kept[::-1]
