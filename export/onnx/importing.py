"""A velocity graph that somebody else trained becomes a bundle, in a process that may take only so much."""

import sys
from pathlib import Path
from typing import Final

import msgspec
from onnx import ModelProto

from edge_runtime.common.bounded_child import Bounds, ChildError, Task, result_of, work
from edge_runtime.errors import PolicyError
from edge_runtime.policy.weights import FlowWeights
from export.bundle.facts import Facts
from export.bundle.parity import SAMPLES, random_inputs
from export.bundle.writer import bundle_draft, write_bundle
from export.onnx.affine import NotAnMlpError
from export.onnx.foreign import read_velocity_graph
from export.onnx.graph import lowered, velocity_graph
from export.onnx.jacobian import with_jacobian
from export.onnx.mlp import read_flow_weights
from export.onnx.reference import GraphReference

BOUNDS: Final = Bounds(seconds=120, memory_mib=2048)


class Imported(msgspec.Struct, frozen=True):
    """What came of a graph."""

    difference: float
    """The largest one between the forms of the policy."""
    how: str
    """Who computes it on the robot."""


class _Import(Task, frozen=True, kw_only=True):
    file: str
    facts: Facts
    draft: str


def import_graph(
    file: Path, facts: Facts, target: Path, *, force: bool = False, bounds: Bounds = BOUNDS
) -> Imported:
    """Write the bundle of a velocity graph that was trained elsewhere.

    Raises:
        PolicyError: if the graph does not fit, cannot be differentiated, differs from its own bundle, or
            takes more than the bounds to find out.
        ConfigError: if ``target`` exists, or cannot be written.
    """
    with bundle_draft(target, force=force) as draft:
        task = _Import(bounds=bounds, file=str(file), facts=facts, draft=str(draft))
        try:
            return msgspec.json.decode(result_of(__name__, task), type=Imported)
        except ChildError as error:
            told = str(error)
            raise PolicyError(told if told.startswith(f"{file}: ") else f"{file}: {told}") from error


def _import(task: _Import) -> str:
    facts = task.facts
    source = read_velocity_graph(Path(task.file), len(facts.action), facts.observation_dim)
    weights, how = _expressed(source)
    graph = with_jacobian(lowered(source) if weights is None else velocity_graph(weights))
    reference = GraphReference(source)
    inputs = reference.smooth(random_inputs(facts, 2 * SAMPLES), SAMPLES)
    expected = reference.evaluate(inputs)
    difference = write_bundle(Path(task.draft), facts, graph, weights, inputs, expected)
    return msgspec.json.encode(Imported(difference, how)).decode()


def _expressed(source: ModelProto) -> tuple[FlowWeights | None, str]:
    try:
        return read_flow_weights(source), "numpy"
    except NotAnMlpError as reason:
        return None, f"onnxruntime ({reason})"


if __name__ == "__main__":
    sys.exit(work(sys.argv[1:], _Import, _import))
