"""What a velocity graph means, in double precision: the truth that float32 forms are held against."""

import math

import numpy as np
from onnx import ModelProto
from onnx.reference import ReferenceEvaluator
from onnx.reference.op_run import OpRun

from edge_runtime.common.arrays import Floats
from edge_runtime.errors import PolicyError
from export.bundle.parity import Inputs
from export.onnx.elements import TO_DOUBLE, retyped

STEP = 3e-4
"""h of the differences: so wide that no kink of a float32 form lies beyond the stencil that sees it."""
KINK = 1e-6
"""Largest fourth difference over h of a smooth field; a change of slope (Relu, Clip) leaves its own size."""


class Erf(OpRun):
    """The error function; onnx's own reference rounds it to single precision."""

    def _run(self, x: Floats) -> tuple[Floats]:
        return (_erf(x),)


class Gelu(OpRun):
    """x Phi(x); onnx's own reference goes through its error function."""

    def _run(self, x: Floats, approximate: str | None = None) -> tuple[Floats]:
        if approximate == "tanh":
            return (x * (1 + np.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * x**3))) / 2,)
        return (x * (1 + _erf(x / math.sqrt(2))) / 2,)


class GraphReference:
    """A velocity graph in double precision, its Jacobian by finite differences of fourth order.

    Args:
        model: a graph without a Jacobian, as `read_velocity_graph` returns it.
    """

    def __init__(self, model: ModelProto) -> None:
        self._evaluator = ReferenceEvaluator(retyped(model, TO_DOUBLE), new_ops=[Erf, Gelu])

    def evaluate(self, inputs: Inputs) -> Floats:
        """Velocity and derivatives (1 + d, B, d), laid out as `FlowPolicy.evaluate` does."""
        far_behind, behind, here, ahead, far_ahead = self._stencil(inputs)
        derivatives = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * STEP)
        return np.concatenate([here[:1], derivatives])

    def smooth(self, inputs: Inputs, count: int) -> Inputs:
        """The first ``count`` inputs at which the derivatives exist: none within reach of a kink.

        Raises:
            PolicyError: if there are fewer.
        """
        far_behind, behind, here, ahead, far_ahead = self._stencil(inputs)
        fourth = (far_behind - 4 * behind + 6 * here - 4 * ahead + far_ahead) / STEP
        fits = (np.abs(fourth) <= KINK * np.maximum(1.0, np.abs(here))).all(axis=(0, 2))
        if fits.sum() < count:
            raise PolicyError(
                f"the graph is smooth at only {fits.mean():.0%} of random inputs, too few to check its "
                "Jacobian: guidance needs a field smooth in the action (SiLU, tanh, GELU)"
            )
        return inputs.select(np.flatnonzero(fits)[:count])

    def _stencil(self, inputs: Inputs) -> Floats:
        """Velocities (5, d, B, d) from two steps behind to two ahead of each component of the action."""
        steps = STEP * np.eye(inputs.action.shape[1])
        return np.array(
            [[self._velocity(inputs, inputs.action + k * step) for step in steps] for k in range(-2, 3)]
        )

    def _velocity(self, inputs: Inputs, action: Floats) -> Floats:
        feed = {"action": action, "tau": inputs.tau[:, None], "observation": inputs.observation}
        try:
            return self._evaluator.run(["velocity"], feed)[0]
        except MemoryError:
            raise
        except Exception as error:  # each operator's numpy code fails in its own way
            raise PolicyError(
                f"the graph cannot be computed for a batch of {len(action)} ({error}): "
                "export it with a dynamic batch dimension (dynamic_axes of torch.onnx.export)"
            ) from error


_erf = np.vectorize(math.erf, otypes=[np.float64])
