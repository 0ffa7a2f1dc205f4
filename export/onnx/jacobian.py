"""Forward-mode differentiation of an ONNX graph: appends dv/da to a graph that computes v.

Beside every tensor that depends on the action run d tangents, its derivatives by each component of the
action; each node's rule in ``onnx_tangents`` or ``onnx_slopes`` computes the tangents
of its output from those of its inputs.
"""

import onnx
from onnx import ModelProto, NodeProto, TensorProto, helper

from edge_runtime.errors import PolicyError
from export.onnx.nodes import BATCH, NodeWriter, reads
from export.onnx.slopes import SLOPES, multiply_slope
from export.onnx.tangents import FLAT, OF_FIRST, RULES
from export.onnx.trace import Trace

MIN_OPSET = 13
"""From here on reductions and Unsqueeze take their axes the way the rules write them."""


def with_jacobian(model: ModelProto) -> ModelProto:
    """Add the output ``jacobian`` (B, d, d), [b, i, j] = d velocity_i / d action_j.

    Args:
        model: a graph with an input ``action`` (B, d) and an output ``velocity`` (B, d), of opset 13 or
            newer and without functions of its own.

    Raises:
        PolicyError: if an operator between action and velocity has no rule (the message lists those that
            have), or velocity does not depend on action.
    """
    inferred = onnx.shape_inference.infer_shapes(model, data_prop=True).graph
    action_dim = next(
        value.type.tensor_type.shape.dim[1].dim_value for value in inferred.input if value.name == "action"
    )
    trace = Trace(NodeWriter("jacobian", _names(inferred)), _types(inferred), action_dim)
    for node in model.graph.node:
        trace.writer.nodes.append(node)
        if not reads(node).isdisjoint(trace.tangents):
            _differentiate(trace, node)
    if "velocity" not in trace.tangents:
        raise PolicyError("velocity does not depend on action: this graph is no flow over actions")
    columns = [
        trace.writer.op("Unsqueeze", tangent, trace.integers(2)) for tangent in trace.tangents["velocity"]
    ]
    trace.writer.op("Concat", *columns, axis=2, output="jacobian")
    return _extended(model, trace.writer, action_dim)


def supported_operators() -> list[str]:
    """Names of the operators that can lie between action and velocity."""
    return sorted({*FLAT, *RULES, *SLOPES})


def _differentiate(trace: Trace, node: NodeProto) -> None:
    if node.op_type in FLAT or not any(trace.is_float(name) for name in node.output):
        return
    if node.domain not in ("", "ai.onnx") or node.op_type not in RULES | SLOPES:
        name = f"{node.domain}::{node.op_type}" if node.domain else node.op_type
        known = ", ".join(supported_operators())
        raise PolicyError(f"operator {name} cannot be differentiated; supported are {known}")
    if node.op_type in SLOPES | OF_FIRST and not trace.tangents.keys().isdisjoint(node.input[1:]):
        raise PolicyError(f"operator {node.op_type} can be differentiated by its first input alone")
    if node.op_type in SLOPES:
        multiply_slope(trace, node)
    else:
        RULES[node.op_type](trace, node)


def _extended(model: ModelProto, writer: NodeWriter, action_dim: int) -> ModelProto:
    shape = [BATCH, action_dim, action_dim]
    jacobian = helper.make_tensor_value_info("jacobian", TensorProto.FLOAT, shape)
    result = ModelProto()
    result.CopyFrom(model)
    del result.graph.node[:]
    result.graph.node.extend(writer.nodes)
    result.graph.initializer.extend(writer.constants)
    result.graph.output.append(jacobian)
    onnx.checker.check_model(result, full_check=True)
    return result


def _names(graph: onnx.GraphProto) -> set[str]:
    values = [*graph.input, *graph.initializer, *graph.value_info]
    return {value.name for value in values} | {name for node in graph.node for name in node.output}


def _types(graph: onnx.GraphProto) -> dict[str, onnx.TypeProto.Tensor]:
    stored = [helper.make_tensor_value_info(t.name, t.data_type, t.dims) for t in graph.initializer]
    values = [*graph.input, *graph.output, *graph.value_info, *stored]
    return {value.name: value.type.tensor_type for value in values}
