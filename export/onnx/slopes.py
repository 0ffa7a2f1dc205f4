"""Derivatives f'(x) of the ONNX operators that apply one function to every element."""

import math
from collections.abc import Callable

from onnx import NodeProto

from export.onnx.nodes import attribute
from export.onnx.trace import Trace

Slope = Callable[[Trace, NodeProto], str]
"""Writes f'(x) for a node y = f(x) and returns its name."""

_SELU_ALPHA, _SELU_GAMMA = 1.67326319217681884765625, 1.05070102214813232421875


def multiply_slope(trace: Trace, node: NodeProto) -> None:
    """Tangents of an elementwise function of the first input: y' = f'(x) x'."""
    slope = SLOPES[node.op_type](trace, node)
    trace.tangents[node.output[0]] = [
        trace.writer.op("Mul", slope, tangent) for tangent in trace.tangents[node.input[0]]
    ]


def _sigmoid_slope(trace: Trace, y: str) -> str:
    """y (1 - y) for y = sigmoid(x)."""
    return trace.writer.op("Mul", y, trace.writer.op("Sub", trace.number(1.0, y), y))


def _sigmoid(trace: Trace, node: NodeProto) -> str:
    return _sigmoid_slope(trace, node.output[0])


def _tanh_slope(trace: Trace, y: str) -> str:
    return trace.writer.op("Sub", trace.number(1.0, y), trace.writer.op("Mul", y, y))


def _tanh(trace: Trace, node: NodeProto) -> str:
    return _tanh_slope(trace, node.output[0])


def _relu(trace: Trace, node: NodeProto) -> str:
    (x,) = node.input
    return trace.writer.op("Cast", _positive(trace, x), to=trace.element(x))


def _clip(trace: Trace, node: NodeProto) -> str:
    x, y = node.input[0], node.output[0]
    return trace.writer.op("Cast", trace.writer.op("Equal", x, y), to=trace.element(x))


def _leaky_relu(trace: Trace, node: NodeProto) -> str:
    (x,) = node.input
    low = trace.number(_float(node, "alpha", 0.01), x)
    return trace.writer.op("Where", _positive(trace, x), trace.number(1.0, x), low)


def _elu(trace: Trace, node: NodeProto) -> str:
    """alpha exp(x) = y + alpha below zero."""
    return _exponential_unit(trace, node, 1.0, _float(node, "alpha", 1.0))


def _selu(trace: Trace, node: NodeProto) -> str:
    """gamma alpha exp(x) = y + gamma alpha below zero, gamma above."""
    gamma = _float(node, "gamma", _SELU_GAMMA)
    return _exponential_unit(trace, node, gamma, gamma * _float(node, "alpha", _SELU_ALPHA))


def _exponential_unit(trace: Trace, node: NodeProto, above: float, shift: float) -> str:
    x, y = node.input[0], node.output[0]
    below = trace.writer.op("Add", y, trace.number(shift, x))
    return trace.writer.op("Where", _positive(trace, x), trace.number(above, x), below)


def _softplus(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Sigmoid", node.input[0])


def _swish(trace: Trace, node: NodeProto) -> str:
    """s + (a x) s (1 - s) with s = sigmoid(a x)."""
    (x,), writer = node.input, trace.writer
    scaled = writer.op("Mul", x, trace.number(_float(node, "alpha", 1.0), x))
    gate = writer.op("Sigmoid", scaled)
    return writer.op("Add", gate, writer.op("Mul", scaled, _sigmoid_slope(trace, gate)))


def _erf(trace: Trace, node: NodeProto) -> str:
    return _gaussian(trace, node.input[0], 2 / math.sqrt(math.pi), -1.0)


def _gelu(trace: Trace, node: NodeProto) -> str:
    return _gelu_tanh(trace, node) if attribute(node, "approximate") == b"tanh" else _gelu_exact(trace, node)


def _gelu_exact(trace: Trace, node: NodeProto) -> str:
    """Phi(x) + x phi(x)."""
    (x,), writer = node.input, trace.writer
    erf = writer.op("Erf", writer.op("Mul", x, trace.number(math.sqrt(0.5), x)))
    half = trace.number(0.5, x)
    cumulative = writer.op("Add", writer.op("Mul", erf, half), half)
    density = _gaussian(trace, x, 1 / math.sqrt(2 * math.pi), -0.5)
    return writer.op("Add", cumulative, writer.op("Mul", x, density))


def _gelu_tanh(trace: Trace, node: NodeProto) -> str:
    """y = x (1 + t) / 2, t = tanh(u), u = c (x + a x^3): y' = (1 + t) / 2 + x (1 - t^2) u' / 2."""
    (x,), writer, c = node.input, trace.writer, math.sqrt(2 / math.pi)
    square = writer.op("Mul", x, x)

    def even(a: float) -> str:
        """c + c a x^2."""
        scaled = writer.op("Mul", square, trace.number(c * a, x))
        return writer.op("Add", scaled, trace.number(c, x))

    t = writer.op("Tanh", writer.op("Mul", x, even(0.044715)))
    bend = writer.op("Mul", _tanh_slope(trace, t), even(3 * 0.044715))
    total = writer.op("Add", writer.op("Add", t, trace.number(1.0, x)), writer.op("Mul", x, bend))
    return writer.op("Mul", total, trace.number(0.5, x))


def _gaussian(trace: Trace, x: str, scale: float, exponent: float) -> str:
    """scale * exp(exponent * x^2)."""
    writer = trace.writer
    power = writer.op("Mul", writer.op("Mul", x, x), trace.number(exponent, x))
    return writer.op("Mul", writer.op("Exp", power), trace.number(scale, x))


def _exp(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Identity", node.output[0])


def _log(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Reciprocal", node.input[0])


def _sqrt(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Div", trace.number(0.5, node.input[0]), node.output[0])


def _reciprocal(trace: Trace, node: NodeProto) -> str:
    y = node.output[0]
    return trace.writer.op("Neg", trace.writer.op("Mul", y, y))


def _abs(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Sign", node.input[0])


def _sin(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Cos", node.input[0])


def _cos(trace: Trace, node: NodeProto) -> str:
    return trace.writer.op("Neg", trace.writer.op("Sin", node.input[0]))


def _positive(trace: Trace, x: str) -> str:
    return trace.writer.op("Greater", x, trace.number(0.0, x))


def _float(node: NodeProto, name: str, default: float) -> float:
    return float(attribute(node, name, default))


SLOPES: dict[str, Slope] = {
    "Abs": _abs,
    "Clip": _clip,
    "Cos": _cos,
    "Elu": _elu,
    "Erf": _erf,
    "Exp": _exp,
    "Gelu": _gelu,
    "LeakyRelu": _leaky_relu,
    "Log": _log,
    "Reciprocal": _reciprocal,
    "Relu": _relu,
    "Selu": _selu,
    "Sigmoid": _sigmoid,
    "Sin": _sin,
    "Softplus": _softplus,
    "Sqrt": _sqrt,
    "Swish": _swish,
    "Tanh": _tanh,
}
