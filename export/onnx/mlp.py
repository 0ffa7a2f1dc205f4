"""Recognise a velocity graph that is a plain MLP and read its weights, whatever its nodes look like.

The walk keeps every tensor as an affine function of its sources, so normalisations, scales, sums of
separate products and any order of concatenation melt into the layers' matrices.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from edge_runtime.common.arrays import Floats
from edge_runtime.policy.weights import Activation, FlowWeights
from export.onnx.affine import (
    Affine,
    Hidden,
    Input,
    NotAnMlpError,
    Sines,
    Source,
    concatenated,
    constant,
    to_flow_weights,
    total,
)
from export.onnx.nodes import attribute, reads

MINUS: Final = np.array([-1.0])


@dataclass(frozen=True, eq=False)
class Gate:
    """sigmoid(x), one factor of SiLU."""

    argument: Affine


Value = Affine | Gate | npt.NDArray[Any]


def read_flow_weights(model: ModelProto) -> FlowWeights:
    """Read the weights of an MLP over action, observation, tau and sines of tau.

    Args:
        model: a graph as `read_velocity_graph` returns it.

    Raises:
        NotAnMlpError: says which node or structure the numpy runtime cannot express.
    """
    walk = _Walk(model)
    for node in model.graph.node:
        walk.visit(node)
    return to_flow_weights(walk.affine("velocity"))


class _Walk:
    """The values of the tensors seen so far."""

    def __init__(self, model: ModelProto) -> None:
        self._opsets = model.opset_import
        self.values: dict[str, Value] = {
            tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer
        }
        for value in model.graph.input:
            size = value.type.tensor_type.shape.dim[1].dim_value
            self.values[value.name] = _whole(Input(value.name, size))

    def visit(self, node: NodeProto) -> None:
        """Compute the value of one node's output."""
        if all(isinstance(self.values[name], np.ndarray) for name in reads(node)):
            self._fold(node)
        elif node.domain in ("", "ai.onnx") and node.op_type in RULES:
            self.values[node.output[0]] = RULES[node.op_type](self, node)
        else:
            raise NotAnMlpError(f"{node.op_type} is no part of a plain MLP")

    def affine(self, name: str) -> Affine:
        """Tensor ``name``, which must be affine in its sources."""
        value = self.values[name]
        if not isinstance(value, Affine):
            raise NotAnMlpError(f"{name} is not affine in the inputs or in one layer")
        return value

    def affine_or_row(self, name: str) -> Affine:
        """Tensor ``name``, which may be a constant row."""
        value = self.values[name]
        return constant(_row(value)) if isinstance(value, np.ndarray) else self.affine(name)

    def constant(self, name: str) -> Floats:
        """Tensor ``name``, which must be constant."""
        value = self.values[name]
        if not isinstance(value, np.ndarray):
            raise NotAnMlpError(f"{name} is a factor or divisor that varies")
        return value.astype(np.float64)

    def _fold(self, node: NodeProto) -> None:
        given = {name: self.values[name] for name in reads(node)}
        names = [name for name in node.output if name]
        inputs, outputs = (list(map(helper.make_empty_tensor_value_info, each)) for each in (given, names))
        graph = helper.make_graph([node], "constant", inputs, outputs)
        evaluator = ReferenceEvaluator(helper.make_model(graph, opset_imports=self._opsets))
        self.values.update(zip(names, evaluator.run(None, given), strict=True))


def _identity(walk: _Walk, node: NodeProto) -> Value:
    return walk.values[node.input[0]]


def _cast(walk: _Walk, node: NodeProto) -> Value:
    if attribute(node, "to") not in (TensorProto.FLOAT, TensorProto.DOUBLE):
        raise NotAnMlpError("Cast rounds")
    return walk.values[node.input[0]]


def _negate(walk: _Walk, node: NodeProto) -> Value:
    return walk.affine(node.input[0]).scaled(MINUS)


def _add(walk: _Walk, node: NodeProto) -> Value:
    return total([walk.affine_or_row(name) for name in node.input])


def _subtract(walk: _Walk, node: NodeProto) -> Value:
    left, right = (walk.affine_or_row(name) for name in node.input)
    return total([left, right.scaled(MINUS)])


def _multiply(walk: _Walk, node: NodeProto) -> Value:
    left, right = node.input
    for x, gate in ((left, right), (right, left)):
        factor = walk.values[gate]
        if isinstance(factor, Gate) and factor.argument is walk.values[x]:
            return _hidden(factor.argument, "silu")
        if isinstance(factor, np.ndarray):
            return walk.affine(x).scaled(_row(factor))
    raise NotAnMlpError(f"{left} and {right} are multiplied, and neither is constant")


def _divide(walk: _Walk, node: NodeProto) -> Value:
    return walk.affine(node.input[0]).scaled(1 / _row(walk.constant(node.input[1])))


def _matmul(walk: _Walk, node: NodeProto) -> Value:
    return walk.affine(node.input[0]).product(_matrix(walk.constant(node.input[1])))


def _gemm(walk: _Walk, node: NodeProto) -> Value:
    if attribute(node, "transA", 0):
        raise NotAnMlpError("Gemm transposes the batch")
    x, name, *bias = filter(None, node.input)
    matrix = _matrix(walk.constant(name)) * attribute(node, "alpha", 1.0)
    product = walk.affine(x).product(matrix.T if attribute(node, "transB", 0) else matrix)
    beta = np.array([attribute(node, "beta", 1.0)])
    return total([product, *(walk.affine_or_row(name).scaled(beta) for name in bias)])


def _concat(walk: _Walk, node: NodeProto) -> Value:
    if attribute(node, "axis") not in (1, -1):
        raise NotAnMlpError("Concat runs along the batch")
    return concatenated([walk.affine(name) for name in node.input])


def _sin(walk: _Walk, node: NodeProto) -> Value:
    return _sines(walk.affine(node.input[0]), 0.0)


def _cos(walk: _Walk, node: NodeProto) -> Value:
    return _sines(walk.affine(node.input[0]), np.pi / 2)


def _sigmoid(walk: _Walk, node: NodeProto) -> Value:
    return Gate(walk.affine(node.input[0]))


def _swish(walk: _Walk, node: NodeProto) -> Value:
    if attribute(node, "alpha", 1.0) != 1.0:
        raise NotAnMlpError("Swish has an alpha other than 1")
    return _hidden(walk.affine(node.input[0]), "silu")


def _tanh(walk: _Walk, node: NodeProto) -> Value:
    return _hidden(walk.affine(node.input[0]), "tanh")


def _sines(angle: Affine, phase: float) -> Affine:
    """sin(angle + phase) as a source of its own."""
    if [source.name for source in angle.terms if isinstance(source, Input)] != ["tau"] or len(
        angle.terms
    ) > 1:
        raise NotAnMlpError("a sine of more than flow time")
    (frequency,) = angle.terms.values()
    return _whole(Sines(frequency[0], angle.bias + phase))


def _hidden(fed: Affine, activation: Activation) -> Affine:
    return _whole(Hidden(fed, activation))


def _whole(source: Source) -> Affine:
    return Affine({source: np.eye(source.size)}, np.zeros(source.size))


def _row(array: npt.NDArray[Any]) -> Floats:
    if array.ndim and array.shape[-1] != array.size:
        raise NotAnMlpError(f"a constant of shape {array.shape} stands where one row would fit")
    return np.asarray(array, np.float64).reshape(-1)


def _matrix(array: Floats) -> Floats:
    if array.ndim != 2:
        raise NotAnMlpError(f"a constant of shape {array.shape} stands where a matrix would fit")
    return array


RULES: dict[str, Callable[[_Walk, NodeProto], Value]] = {
    "Add": _add,
    "Cast": _cast,
    "Concat": _concat,
    "Cos": _cos,
    "Div": _divide,
    "Gemm": _gemm,
    "Identity": _identity,
    "MatMul": _matmul,
    "Mul": _multiply,
    "Neg": _negate,
    "Sigmoid": _sigmoid,
    "Sin": _sin,
    "Sub": _subtract,
    "Swish": _swish,
    "Tanh": _tanh,
}
