"""Puts the branch that is taken in place of an ``If`` that asks for shapes alone.

torch writes one for a squeeze of a dimension whose size it does not know; the sizes of a policy's inputs are
known, and only the batch is free.
"""

from typing import Final

import numpy as np
from onnx import GraphProto, ModelProto, NodeProto, helper
from onnx.reference import ReferenceEvaluator

from edge_runtime.errors import PolicyError
from export.onnx.nodes import attribute, needed, reads

BATCHES: Final = (1, 2, 5)
"""A condition that is the same for these is the same for all."""
_SHAPES: Final = ("Shape", "Size")


def with_chosen_branches(model: ModelProto) -> ModelProto:
    """Return the model without the ``If`` nodes, outside of others, whose conditions follow from shapes.

    Raises:
        PolicyError: if a condition depends on the size of the batch.
    """
    while decided := [node for node in model.graph.node if node.op_type == "If" and _is_fixed(model, node)]:
        conditions = [node.input[0] for node in decided]
        taken = dict(zip(conditions, _values(model, conditions), strict=True))
        nodes: list[NodeProto] = []
        for node in model.graph.node:
            if node not in decided:
                nodes.append(node)
                continue
            branch = attribute(node, "then_branch" if taken[node.input[0]] else "else_branch")
            nodes += _inlined(node, branch)
            model.graph.initializer.extend(branch.initializer)
        del model.graph.node[:]
        model.graph.node.extend(nodes)
    return model


def _is_fixed(model: ModelProto, node: NodeProto) -> bool:
    """Whether its condition comes from constants and shapes alone."""
    asked = {node.input[0]}
    for source in reversed(model.graph.node):
        if not asked.isdisjoint(source.output):
            asked -= set(source.output)
            asked |= set() if source.op_type in _SHAPES else reads(source)
    return asked.isdisjoint(value.name for value in model.graph.input)


def _values(model: ModelProto, conditions: list[str]) -> list[bool]:
    graph = helper.make_graph(
        needed(model.graph.node, conditions),
        "conditions",
        model.graph.input,
        [helper.make_empty_tensor_value_info(name) for name in dict.fromkeys(conditions)],
        model.graph.initializer,
    )
    evaluator = ReferenceEvaluator(helper.make_model(graph, opset_imports=model.opset_import))
    sizes = {value.name: value.type.tensor_type.shape.dim[1].dim_value for value in model.graph.input}
    found = {
        tuple(
            bool(np.asarray(value).item())
            for value in evaluator.run(
                conditions, {name: np.zeros((batch, size), np.float32) for name, size in sizes.items()}
            )
        )
        for batch in BATCHES
    }
    if len(found) > 1:
        raise PolicyError(
            "the branch of an If depends on the size of the batch: name the dimension that is squeezed, "
            "such as squeeze(1), where the graph is exported"
        )
    return list(found.pop())


def _inlined(node: NodeProto, branch: GraphProto) -> list[NodeProto]:
    results = zip(branch.output, node.output, strict=True)
    return [
        *branch.node,
        *(helper.make_node("Identity", [result.name], [name]) for result, name in results if name),
    ]
