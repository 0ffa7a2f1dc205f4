"""The state of forward-mode differentiation: tangents so far, shapes and types of tensors."""

from collections.abc import Sequence

import numpy as np
import onnx
from onnx import TensorProto, helper

from export.onnx.nodes import NodeWriter

_FLOATS = (TensorProto.FLOAT, TensorProto.DOUBLE, TensorProto.FLOAT16, TensorProto.BFLOAT16)


class Trace:
    """The tangents known so far, and what the graph's shape inference says of its tensors."""

    def __init__(self, writer: NodeWriter, types: dict[str, onnx.TypeProto.Tensor], action_dim: int) -> None:
        self.writer = writer
        self._types = types
        self.tangents: dict[str, list[str]] = {"action": self._unit_vectors(action_dim)}

    def _unit_vectors(self, action_dim: int) -> list[str]:
        shape = self.writer.op("Shape", "action")
        return [
            self.writer.op("Expand", self.writer.constant(row[None]), shape) for row in np.eye(action_dim)
        ]

    def is_float(self, name: str) -> bool:
        """Whether a tensor has floating-point elements."""
        return self.element(name) in _FLOATS

    def element(self, name: str) -> int:
        """The ONNX element type of a tensor; unknown counts as float32."""
        return self._types[name].elem_type if name in self._types else TensorProto.FLOAT

    def dims(self, name: str) -> list[object] | None:
        """Sizes or symbols of a tensor's dimensions; None where one is unknown."""
        if name not in self._types or not self._types[name].HasField("shape"):
            return None
        dims = [getattr(dim, dim.WhichOneof("value") or "dim_param") for dim in self._types[name].shape.dim]
        return None if "" in dims else dims

    def number(self, value: float, like: str) -> str:
        """A scalar constant of the element type of tensor ``like``."""
        return self.writer.constant(value, helper.tensor_dtype_to_np_dtype(self.element(like)))

    def integers(self, *values: int) -> str:
        """A vector of integers: axes or a shape."""
        return self.writer.constant(values, np.int64)

    def zeros(self, name: str) -> str:
        """Zeros of the shape of tensor ``name``."""
        return self.writer.op("Expand", self.number(0.0, name), self.writer.op("Shape", name))

    def shaped(self, tangent: str, source: str, target: str) -> str:
        """The tangent of ``source`` broadcast to the shape of ``target``."""
        if self.dims(source) is not None and self.dims(source) == self.dims(target):
            return tangent
        return self.writer.op("Expand", tangent, self.writer.op("Shape", target))

    def add(self, *terms: Sequence[str]) -> list[str]:
        """Sum tangents that several inputs contribute, direction by direction."""
        total = list(terms[0])
        for term in terms[1:]:
            total = [self.writer.op("Add", a, b) for a, b in zip(total, term, strict=True)]
        return total
