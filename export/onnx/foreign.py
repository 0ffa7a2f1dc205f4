"""Read a velocity graph that somebody else exported and bring it into the form of a bundle's graph."""

from pathlib import Path

import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import ModelProto, TensorProto, helper, numpy_helper
from onnx.inliner import inline_local_functions
from onnx.utils import Extractor
from onnx.version_converter import convert_version

from edge_runtime.errors import PolicyError
from export.onnx.jacobian import MIN_OPSET
from export.onnx.nodes import BATCH

INPUTS = ("action", "tau", "observation")


def read_velocity_graph(path: Path, action_dim: int, observation_dim: int) -> ModelProto:
    """Read a float32 graph over action (B, d), tau (B, 1) and observation (B, O).

    Its only output, or the one named velocity, becomes ``velocity`` (B, d); everything that does not lead
    there is dropped, and the batch dimension is freed.

    Raises:
        PolicyError: names what the graph has and what it should have.
    """
    model = _load(path)
    _check_inputs(model, {"action": action_dim, "tau": 1, "observation": observation_dim}, path)
    output = _velocity_output(model, path)
    try:
        model = _reduced(_with_supported_opset(model), output)
        onnx.checker.check_model(model, full_check=True)
    except (onnx.checker.ValidationError, onnx.shape_inference.InferenceError, ValueError) as error:
        raise PolicyError(f"{path}: not a valid velocity graph ({_first_line(error)})") from error
    _check_constants(model, path)
    return _with_free_batch(model, action_dim)


def _load(path: Path) -> ModelProto:
    try:
        return onnx.load(path)
    except OSError as error:
        raise PolicyError(f"{path}: cannot be read ({error.strerror})") from error
    except (DecodeError, onnx.checker.ValidationError) as error:
        raise PolicyError(f"{path}: not an ONNX file ({_first_line(error)})") from error


def _check_inputs(model: ModelProto, sizes: dict[str, int], path: Path) -> None:
    stored = {tensor.name for tensor in model.graph.initializer}
    found = {value.name: value for value in model.graph.input if value.name not in stored}
    if sorted(found) != sorted(INPUTS):
        raise PolicyError(
            f"{path}: has inputs {', '.join(found) or 'none'}; needs exactly {', '.join(INPUTS)}: "
            "rename them where the graph is exported (input_names of torch.onnx.export)"
        )
    for name, size in sizes.items():
        tensor = found[name].type.tensor_type
        dims = [dim.dim_value or dim.dim_param or "?" for dim in tensor.shape.dim]
        if tensor.elem_type != TensorProto.FLOAT or len(dims) != 2 or dims[1] != size:
            kind = TensorProto.DataType.Name(tensor.elem_type).lower()
            raise PolicyError(
                f"{path}: input {name} is {kind} ({', '.join(map(str, dims))}); "
                f"the policy's facts need float (batch, {size})"
            )


def _check_constants(model: ModelProto, path: Path) -> None:
    for tensor in model.graph.initializer:
        array = numpy_helper.to_array(tensor)
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise PolicyError(f"{path}: constant {tensor.name} holds values that are not finite")


def _velocity_output(model: ModelProto, path: Path) -> str:
    names = [value.name for value in model.graph.output]
    if "velocity" in names:
        return "velocity"
    if len(names) != 1:
        raise PolicyError(f"{path}: has outputs {', '.join(names)}; needs one, or one named velocity")
    return names[0]


def _with_supported_opset(model: ModelProto) -> ModelProto:
    version = next((entry.version for entry in model.opset_import if entry.domain in ("", "ai.onnx")), 1)
    if version >= MIN_OPSET:
        return model
    try:
        return convert_version(model, MIN_OPSET)
    except RuntimeError as error:
        raise ValueError(f"opset {version} is older than {MIN_OPSET} and cannot be converted") from error


def _reduced(model: ModelProto, output: str) -> ModelProto:
    """Only the nodes between inputs and ``output``, functions inlined, the output named velocity."""
    model = inline_local_functions(model)
    model = Extractor(model).extract_model(list(INPUTS), [output])
    if output != "velocity":
        model.graph.node.append(helper.make_node("Identity", [output], ["velocity"]))
        model.graph.output[0].name = "velocity"
    return model


def _with_free_batch(model: ModelProto, action_dim: int) -> ModelProto:
    del model.graph.value_info[:]  # sizes inferred under the old batch dimension
    for value in model.graph.input:
        value.type.tensor_type.shape.dim[0].dim_param = BATCH
    velocity = helper.make_tensor_value_info("velocity", TensorProto.FLOAT, [BATCH, action_dim])
    model.graph.output[0].CopyFrom(velocity)
    return model


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0]
