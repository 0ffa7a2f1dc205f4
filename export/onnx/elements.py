"""A graph over other element types than it was written for."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from onnx import GraphProto, ModelProto, NodeProto, TensorProto, helper, numpy_helper

from export.onnx.nodes import attribute, subgraphs

TO_SINGLE: Final = {TensorProto.FLOAT16: TensorProto.FLOAT, TensorProto.BFLOAT16: TensorProto.FLOAT}
"""Half precision is a rounding, no part of what a graph means."""
TO_DOUBLE: Final = {TensorProto.FLOAT: TensorProto.DOUBLE}
_TYPES: Final = ("to", "dtype")
"""Attributes that name an element type."""


def retyped(model: ModelProto, types: Mapping[int, int]) -> ModelProto:
    """Return a copy of the model whose constants and casts have other element types."""
    result = ModelProto()
    result.CopyFrom(model)
    _retype_graph(result.graph, types)
    return result


def _retype_graph(graph: GraphProto, types: Mapping[int, int]) -> None:
    for tensor in graph.initializer:
        _retype_tensor(tensor, types)
    for value in (*graph.input, *graph.output, *graph.value_info):
        tensor_type = value.type.tensor_type
        if tensor_type.elem_type in types:
            tensor_type.elem_type = types[tensor_type.elem_type]
    for node in graph.node:
        _state_value(node)
        for entry in node.attribute:
            for tensor in (*entry.tensors, *((entry.t,) if entry.HasField("t") else ())):
                _retype_tensor(tensor, types)
            if entry.name in _TYPES and entry.i in types:
                entry.i = types[entry.i]
        for inner in subgraphs(node):
            _retype_graph(inner, types)


def _state_value(node: NodeProto) -> None:
    """Make a value that is single precision by the operator's definition one that has a type."""
    value = attribute(node, "value_float", attribute(node, "value_floats"))
    if node.op_type == "ConstantOfShape" and not node.attribute:
        value = [0.0]
    if value is not None and node.op_type in ("Constant", "ConstantOfShape"):
        del node.attribute[:]
        tensor = numpy_helper.from_array(np.array(value, np.float32))
        node.attribute.append(helper.make_attribute("value", tensor))


def _retype_tensor(tensor: TensorProto, types: Mapping[int, int]) -> None:
    if tensor.data_type in types:
        kind = helper.tensor_dtype_to_np_dtype(types[tensor.data_type])
        array = numpy_helper.to_array(tensor).astype(kind)
        tensor.CopyFrom(numpy_helper.from_array(array, tensor.name))
