"""How the tangents of an operator's inputs become those of its output.

`RULES` holds the operators that are more than a function of one tensor's elements (those are in
``onnx_slopes``); `FLAT` ones have a derivative of zero wherever it exists. Every tangent has the shape
of its tensor.
"""

import math
from collections.abc import Callable

from onnx import NodeProto

from edge_runtime.errors import PolicyError
from export.onnx.nodes import attribute
from export.onnx.trace import Trace

Rule = Callable[[Trace, NodeProto], None]


def _linear(trace: Trace, node: NodeProto) -> None:
    """Operators linear in their first input act on tangents as on values."""
    copies = [trace.writer.repeat(node, [t, *node.input[1:]]) for t in trace.tangents[node.input[0]]]
    for output, tangents in zip(node.output, zip(*copies, strict=True), strict=True):
        if output:
            trace.tangents[output] = list(tangents)


def _add(trace: Trace, node: NodeProto) -> None:
    terms = [
        [trace.shaped(tangent, name, node.output[0]) for tangent in trace.tangents[name]]
        for name in node.input
        if name in trace.tangents
    ]
    trace.tangents[node.output[0]] = trace.add(*terms)


def _subtract(trace: Trace, node: NodeProto) -> None:
    left, right = node.input
    terms = []
    if left in trace.tangents:
        terms.append([trace.shaped(t, left, node.output[0]) for t in trace.tangents[left]])
    if right in trace.tangents:
        terms.append(
            [trace.shaped(trace.writer.op("Neg", t), right, node.output[0]) for t in trace.tangents[right]]
        )
    trace.tangents[node.output[0]] = trace.add(*terms)


def _bilinear(trace: Trace, node: NodeProto) -> None:
    """Mul and MatMul: (x y)' = x' y + x y'."""
    x, y = node.input
    terms = []
    if x in trace.tangents:
        terms.append([trace.writer.op(node.op_type, t, y) for t in trace.tangents[x]])
    if y in trace.tangents:
        terms.append([trace.writer.op(node.op_type, x, t) for t in trace.tangents[y]])
    trace.tangents[node.output[0]] = trace.add(*terms)


def _divide(trace: Trace, node: NodeProto) -> None:
    """(x / y)' = x' / y - (x / y) y' / y."""
    (x, y), writer = node.input, trace.writer
    terms = []
    if x in trace.tangents:
        terms.append([writer.op("Div", t, y) for t in trace.tangents[x]])
    if y in trace.tangents:
        ratio = writer.op("Neg", writer.op("Div", node.output[0], y))
        terms.append([writer.op("Mul", ratio, t) for t in trace.tangents[y]])
    trace.tangents[node.output[0]] = trace.add(*terms)


def _gemm(trace: Trace, node: NodeProto) -> None:
    """alpha A B + beta C, with A or B transposed where the node says so."""
    writer, (a, b, *c) = trace.writer, node.input
    alpha = {"alpha": attribute(node, "alpha", 1.0)}
    sides = {**alpha, "transA": attribute(node, "transA", 0), "transB": attribute(node, "transB", 0)}
    terms = []
    if a in trace.tangents:
        terms.append([writer.op("Gemm", t, b, **sides) for t in trace.tangents[a]])
    if b in trace.tangents:
        terms.append([writer.op("Gemm", a, t, **sides) for t in trace.tangents[b]])
    if c and c[0] in trace.tangents:
        beta = trace.number(float(attribute(node, "beta", 1.0)), c[0])
        scaled = [writer.op("Mul", beta, t) for t in trace.tangents[c[0]]]
        terms.append([trace.shaped(t, c[0], node.output[0]) for t in scaled])
    trace.tangents[node.output[0]] = trace.add(*terms)


def _power(trace: Trace, node: NodeProto) -> None:
    """(x ** p)' = p x ** (p - 1) x' for an exponent that does not depend on the action."""
    (x, exponent), writer = node.input, trace.writer
    if exponent in trace.tangents:
        raise PolicyError("operator Pow cannot be differentiated by an exponent that depends on the action")
    exponent = writer.op("Cast", exponent, to=trace.element(x))
    lower = writer.op("Pow", x, writer.op("Sub", exponent, trace.number(1.0, x)))
    slope = writer.op("Mul", exponent, lower)
    trace.tangents[node.output[0]] = [writer.op("Mul", slope, t) for t in trace.tangents[x]]


def _concat(trace: Trace, node: NodeProto) -> None:
    zeros = {name: trace.zeros(name) for name in node.input if name not in trace.tangents}
    directions = range(len(trace.tangents["action"]))
    trace.tangents[node.output[0]] = [
        trace.writer.repeat(node, [zeros.get(x) or trace.tangents[x][j] for x in node.input])[0]
        for j in directions
    ]


def _where(trace: Trace, node: NodeProto) -> None:
    _choose(trace, node, *node.input)


def _extremum(trace: Trace, node: NodeProto) -> None:
    """Max and Min of two tensors follow the tensor that is chosen."""
    if len(node.input) != 2:
        raise PolicyError(
            f"operator {node.op_type} can be differentiated over two inputs, not {len(node.input)}"
        )
    x, y = node.input
    larger = trace.writer.op("Greater", x, y)
    _choose(trace, node, larger, *((x, y) if node.op_type == "Max" else (y, x)))


def _choose(trace: Trace, node: NodeProto, condition: str, x: str, y: str) -> None:
    zeros = {name: trace.zeros(name) for name in (x, y) if name not in trace.tangents}
    trace.tangents[node.output[0]] = [
        trace.writer.op("Where", condition, *(zeros.get(name) or trace.tangents[name][j] for name in (x, y)))
        for j in range(len(trace.tangents["action"]))
    ]


def _softmax(trace: Trace, node: NodeProto) -> None:
    """y' = y (x' - sum(y x'))."""
    writer, y = trace.writer, node.output[0]
    axis = trace.integers(int(attribute(node, "axis", -1)))

    def differentiate(tangent: str) -> str:
        mean = writer.op("ReduceSum", writer.op("Mul", y, tangent), axis, keepdims=1)
        return writer.op("Mul", y, writer.op("Sub", tangent, mean))

    trace.tangents[y] = [differentiate(t) for t in trace.tangents[node.input[0]]]


def _layer_normalization(trace: Trace, node: NodeProto) -> None:
    """With z the normalised x, r = 1 / std and g the scale: y' = g r (x' - mean(x') - z mean(z x'))."""
    writer, (x, scale, *_) = trace.writer, node.input
    sizes, rank = trace.dims(scale), len(trace.dims(x) or ())
    if len([name for name in node.output if name]) != 1 or not rank or sizes is None:
        raise PolicyError("LayerNormalization can be differentiated with one output and known shapes only")
    axis = int(attribute(node, "axis", -1))
    axes = trace.integers(*range(axis % rank, rank))
    share = trace.number(1.0 / math.prod(sizes), x)

    def centred(tensor: str) -> str:
        return writer.op("Sub", tensor, mean(tensor))

    def mean(tensor: str) -> str:
        return writer.op("Mul", writer.op("ReduceSum", tensor, axes, keepdims=1), share)

    deviation = centred(x)
    variance = mean(writer.op("Mul", deviation, deviation))
    epsilon = trace.number(float(attribute(node, "epsilon", 1e-5)), x)
    std = writer.op("Sqrt", writer.op("Add", variance, epsilon))
    z = writer.op("Div", deviation, std)
    gain = writer.op("Div", scale, std)

    def differentiate(tangent: str) -> str:
        along = writer.op("Mul", z, mean(writer.op("Mul", z, tangent)))
        return writer.op("Mul", gain, writer.op("Sub", centred(tangent), along))

    trace.tangents[node.output[0]] = [differentiate(t) for t in trace.tangents[x]]


FLAT = frozenset({"Ceil", "Floor", "Round", "Sign"})
_LINEAR: dict[str, Rule] = dict.fromkeys(
    (
        "Cast",
        "Expand",
        "Flatten",
        "Gather",
        "Identity",
        "Neg",
        "ReduceMean",
        "ReduceSum",
        "Reshape",
        "Slice",
        "Split",
        "Squeeze",
        "Tile",
        "Transpose",
        "Unsqueeze",
    ),
    _linear,
)
OF_FIRST: dict[str, Rule] = {**_LINEAR, "LayerNormalization": _layer_normalization}
"""Those whose rules take every input but the first for one that does not depend on the action."""
RULES: dict[str, Rule] = {
    **OF_FIRST,
    **dict.fromkeys(("Add", "Sum"), _add),
    **dict.fromkeys(("Mul", "MatMul"), _bilinear),
    **dict.fromkeys(("Max", "Min"), _extremum),
    "Concat": _concat,
    "Div": _divide,
    "Gemm": _gemm,
    "Pow": _power,
    "Softmax": _softmax,
    "Sub": _subtract,
    "Where": _where,
}
