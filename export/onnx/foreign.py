"""Read a velocity graph that somebody else exported and bring it into the form of a bundle's graph."""

from pathlib import Path
from typing import Final

import numpy as np
import onnx
from onnx import ModelProto, TensorProto, helper, numpy_helper
from onnx.external_data_helper import load_external_data_for_model
from onnx.inliner import inline_local_functions
from onnx.version_converter import convert_version

from edge_runtime.common.printable import first_line
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import PolicyError
from export.onnx.branches import with_chosen_branches
from export.onnx.elements import TO_SINGLE, retyped
from export.onnx.graph import IR_VERSION
from export.onnx.jacobian import MIN_OPSET
from export.onnx.nodes import BATCH, needed, reads

INPUTS: Final = ("action", "tau", "observation")
LARGEST_GRAPH: Final = 1 << 27
"""Bytes: several times what a robot's bundle holds."""


def read_velocity_graph(path: Path, action_dim: int, observation_dim: int) -> ModelProto:
    """Read a float32 graph over action (B, d), tau (B, 1) and observation (B, O).

    Its only output, or the one named velocity, becomes ``velocity`` (B, d); everything that does not lead
    there is dropped, functions and branches that shapes decide are put in their places, half precision
    becomes single, and the batch dimension is freed.

    Raises:
        PolicyError: names what the graph has and what it should have.
    """
    try:
        content = read_regular(path, LARGEST_GRAPH)
    except OSError as error:
        raise PolicyError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # protobuf's, in one of three implementations
        raise PolicyError(f"{path}: not an ONNX file ({first_line(error)})") from error
    try:
        return _brought_into_form(model, path.parent, action_dim, observation_dim)
    except PolicyError as error:
        raise PolicyError(f"{path}: {error}") from error
    except MemoryError:
        raise
    except Exception as error:  # onnx fails in many ways where a graph is not sound
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise PolicyError(f"{path}: not a valid velocity graph ({reason})") from error


def _brought_into_form(model: ModelProto, folder: Path, action_dim: int, observation_dim: int) -> ModelProto:
    _check_inputs(model, {"action": action_dim, "tau": 1, "observation": observation_dim})
    output = _velocity_output(model)
    load_external_data_for_model(model, str(folder))
    model = _reduced(inline_local_functions(_with_supported_opset(model)), output)
    model = retyped(_reduced(with_chosen_branches(model), output), TO_SINGLE)
    model = _with_free_batch(model, action_dim)
    onnx.checker.check_model(model, full_check=True)
    _check_constants(model)
    return model


def _check_inputs(model: ModelProto, sizes: dict[str, int]) -> None:
    stored = {tensor.name for tensor in model.graph.initializer}
    found = [value for value in model.graph.input if value.name not in stored]
    names = [value.name for value in found]
    if sorted(names) != sorted(INPUTS):
        raise PolicyError(
            f"has inputs {', '.join(names) or 'none'}; needs exactly {', '.join(INPUTS)}: "
            "rename them where the graph is exported (input_names of torch.onnx.export)"
        )
    for value in found:
        tensor, size = value.type.tensor_type, sizes[value.name]
        dims = [dim.dim_value or dim.dim_param or "?" for dim in tensor.shape.dim]
        if tensor.elem_type != TensorProto.FLOAT or len(dims) != 2 or dims[1] != size:
            raise PolicyError(
                f"input {value.name} is {_element(tensor.elem_type)} ({', '.join(map(str, dims))}); "
                f"the policy's facts need float (batch, {size})"
            )


def _velocity_output(model: ModelProto) -> str:
    names = [value.name for value in model.graph.output]
    if "velocity" in names:
        return "velocity"
    if len(names) != 1:
        raise PolicyError(f"has outputs {', '.join(names) or 'none'}; needs one, or one named velocity")
    return names[0]


def _with_supported_opset(model: ModelProto) -> ModelProto:
    version = next((entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")), 1)
    if version > onnx.defs.onnx_opset_version():
        raise PolicyError(
            f"opset {version} is newer than any that onnx {onnx.__version__} knows; update onnx"
        )
    if version >= MIN_OPSET:
        return model
    try:
        return convert_version(model, MIN_OPSET)
    except RuntimeError as error:
        raise PolicyError(
            f"opset {version} is older than {MIN_OPSET} and cannot be converted ({first_line(error)}): "
            f"export it with opset_version={MIN_OPSET} or newer"
        ) from error


def _reduced(model: ModelProto, output: str) -> ModelProto:
    """Only what leads from the inputs to ``output``; weights are no inputs, and nothing else is told."""
    graph = model.graph
    nodes = needed(graph.node, [output])
    names = {output}.union(*map(reads, nodes))
    domains = {node.domain for node in nodes} | {"", "ai.onnx"}
    return helper.make_model(
        helper.make_graph(
            nodes,
            "velocity",
            [next(value for value in graph.input if value.name == name) for name in INPUTS],
            [value for value in graph.output if value.name == output][:1],
            [tensor for tensor in graph.initializer if tensor.name in names],
        ),
        opset_imports=[entry for entry in model.opset_import if entry.domain in domains],
        ir_version=IR_VERSION,
    )


def _with_free_batch(model: ModelProto, action_dim: int) -> ModelProto:
    """The output becomes ``velocity``, and the first dimension of inputs and output is free."""
    (output,) = model.graph.output
    if output.type.tensor_type.elem_type != TensorProto.FLOAT:
        raise PolicyError(f"output {output.name} is {_element(output.type.tensor_type.elem_type)}, not float")
    if output.name != "velocity":
        model.graph.node.append(helper.make_node("Identity", [output.name], ["velocity"]))
    for value in model.graph.input:
        value.type.tensor_type.shape.dim[0].dim_param = BATCH
    velocity = helper.make_tensor_value_info("velocity", TensorProto.FLOAT, [BATCH, action_dim])
    output.CopyFrom(velocity)
    return model


def _check_constants(model: ModelProto) -> None:
    for tensor in model.graph.initializer:
        array = numpy_helper.to_array(tensor)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise PolicyError(f"constant {tensor.name} holds values that are not finite")


def _element(kind: int) -> str:
    return TensorProto.DataType.Name(kind).lower()
