"""`FlowWeights` as an ONNX graph: action (B, d), tau (B, 1), observation (B, O) -> velocity (B, d)."""

import numpy as np
import onnx
from onnx import ModelProto, TensorProto, helper
from onnx.version_converter import convert_version

from edge_runtime.errors import PolicyError
from edge_runtime.policy.weights import FlowWeights
from export.onnx.nodes import BATCH, NodeWriter

OPSET, IR_VERSION = 17, 8
"""Old enough for the oldest onnxruntime that pyproject.toml admits."""
NEWEST_OPSET = 20
"""The newest that it reads."""


def velocity_graph(weights: FlowWeights) -> ModelProto:
    """Write the network of ``edge_runtime.policy.weights`` as a graph of standard operators."""
    writer = NodeWriter("flow")
    # The runtime computes what depends on flow time in double precision; so does the graph.
    tau = writer.op("Cast", "tau", to=TensorProto.DOUBLE)
    x = writer.op("Concat", "action", "observation", *_time_features(writer, weights, tau), axis=1)
    first = np.vstack([weights.action, weights.observation, weights.time])
    for matrix, bias in zip((first, *weights.matrices[:-1]), weights.biases[:-1], strict=True):
        x = _activate(writer, weights, _dense(writer, x, matrix, bias))
    flow = _dense(writer, x, weights.matrices[-1], weights.biases[-1])
    if weights.prior_std is None:
        writer.op("Identity", flow, output="velocity")
    else:
        prior = writer.op("Mul", _prior_gain(writer, weights.prior_std, tau), "action")
        writer.op("Add", flow, prior, output="velocity")
    return _model(writer, weights)


def lowered(model: ModelProto) -> ModelProto:
    """Return a graph in an opset that the oldest onnxruntime reads.

    Raises:
        PolicyError: if one of its operators is newer.
    """
    version = next(entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx"))
    if version <= NEWEST_OPSET:
        return model
    try:
        return convert_version(model, NEWEST_OPSET)
    except RuntimeError as error:
        raise PolicyError(
            f"opset {version} cannot be written as {NEWEST_OPSET}, the newest that every robot's onnxruntime "
            f"reads: export it with opset_version={NEWEST_OPSET}"
        ) from error


def _dense(writer: NodeWriter, x: str, matrix: np.ndarray, bias: np.ndarray) -> str:
    return writer.op("Gemm", x, writer.constant(matrix), writer.constant(bias))


def _activate(writer: NodeWriter, weights: FlowWeights, x: str) -> str:
    if weights.activation == "tanh":
        return writer.op("Tanh", x)
    return writer.op("Mul", x, writer.op("Sigmoid", x))


def _time_features(writer: NodeWriter, weights: FlowWeights, tau: str) -> list[str]:
    if not weights.time_frequency.size:
        return ["tau"]
    angle = writer.op("Mul", tau, writer.constant(weights.time_frequency[None], np.float64))
    angle = writer.op("Add", angle, writer.constant(weights.time_phase[None], np.float64))
    return ["tau", writer.op("Cast", writer.op("Sin", angle), to=TensorProto.FLOAT)]


def _prior_gain(writer: NodeWriter, prior_std: float, tau: str) -> str:
    """k(tau) = (tau s^2 - (1 - tau)) / ((1 - tau)^2 + tau^2 s^2)."""
    variance = writer.constant([[prior_std**2]], np.float64)
    rest = writer.op("Sub", writer.constant([[1.0]], np.float64), tau)
    scaled = writer.op("Mul", tau, variance)
    squares = writer.op("Add", writer.op("Mul", rest, rest), writer.op("Mul", tau, scaled))
    gain = writer.op("Div", writer.op("Sub", scaled, rest), squares)
    return writer.op("Cast", gain, to=TensorProto.FLOAT)


def _model(writer: NodeWriter, weights: FlowWeights) -> ModelProto:
    def batched(name: str, size: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, [BATCH, size])

    d = weights.action_dim
    inputs = [batched("action", d), batched("tau", 1), batched("observation", weights.observation_dim)]
    graph = helper.make_graph(writer.nodes, "flow", inputs, [batched("velocity", d)], writer.constants)
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=IR_VERSION, producer_name="cfpg-edge")
    onnx.checker.check_model(model, full_check=True)
    return model
