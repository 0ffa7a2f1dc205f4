"""Hand-made ONNX graphs of a velocity; needs no PyTorch."""

import numpy as np
import onnx
from onnx import TensorProto, helper


def graph_of(*nodes, constants=None, opset=17):
    """A graph over action (n, 2), tau (n, 1) and observation (n, 2) that computes velocity."""
    sizes = {"action": 2, "tau": 1, "observation": 2}
    graph = helper.make_graph(
        nodes,
        "test",
        [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])
            for name, size in sizes.items()
        ],
        [helper.make_tensor_value_info("velocity", TensorProto.FLOAT, ["batch", 2])],
        [onnx.numpy_helper.from_array(np.array(c), name) for name, c in (constants or {}).items()],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
