"""A flow policy whose graph numpy cannot express: velocity and Jacobian through onnxruntime."""

import importlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Array
from edge_runtime.common.printable import first_line
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import PolicyError
from edge_runtime.policy.flow_steps import SamplerName, flow_steps
from edge_runtime.policy.schema import LARGEST_FILE
from edge_runtime.policy.velocity_field import check_counts, check_observation


class _Tensor(Protocol):
    name: str
    shape: Sequence[int | str]


class _Session(Protocol):
    """What is used of ``onnxruntime.InferenceSession``, which is imported only where it is needed."""

    def run(self, outputs: Sequence[str], inputs: Mapping[str, Array]) -> list[Array]: ...
    def get_inputs(self) -> Sequence[_Tensor]: ...
    def get_outputs(self) -> Sequence[_Tensor]: ...


class OnnxPolicy:
    """v_theta(a, tau | o) and dv/da from the ``policy.onnx`` of a bundle; a `VelocityField`.

    Args:
        graph: inputs action (B, d), tau (B, 1), observation (B, O); outputs velocity (B, d) and
            jacobian (B, d, d) with [b, i, j] = dv_i/da_j.
        action_dim: d.
        observation_dim: O.
        steps: T, the number of flow steps.
        batch: B.
        sampler: how the flow is integrated in them.
        prior_std: s of the prior field, which the graph's velocity includes; None if there is none.

    Raises:
        PolicyError: if a number is below one, onnxruntime is not installed, or the graph does not fit
            or cannot be computed.
    """

    backend = "onnxruntime"
    sampler = None

    def __init__(
        self,
        graph: Path,
        action_dim: int,
        observation_dim: int,
        steps: int,
        batch: int = 1,
        sampler: SamplerName = "euler",
        prior_std: float | None = None,
    ) -> None:
        check_counts(steps, batch)
        self.batch, self.schedule = batch, flow_steps(sampler, steps, prior_std)
        self.action_dim, self.observation_dim = action_dim, observation_dim
        self._graph, self._session = graph, _open_session(graph)
        self._observation = np.zeros((batch, observation_dim), np.float32)
        self._result = np.empty((1 + action_dim, batch, action_dim), np.float32)
        _check_sizes(self._session, {"action": action_dim, "tau": 1, "observation": observation_dim}, graph)
        self.step(0, np.zeros((batch, action_dim), np.float32))

    def observe(self, observation: npt.ArrayLike) -> None:
        """Set the observations (B, O) for the coming steps.

        Raises:
            PolicyError: if the shape is not (B, O).
        """
        observation = np.asarray(observation, np.float32)
        check_observation(observation, *self._observation.shape)
        self._observation = observation.copy()

    def step(self, k: int, action: npt.ArrayLike) -> Array:
        """Velocity and Jacobian at the beginning of a step; see `VelocityField.step`."""
        return self._run(action, np.full(self.batch, self.schedule[k].tau), self._observation)

    def velocity(self, k: int, action: npt.ArrayLike) -> Array:
        """The velocity alone; see `VelocityField.velocity`."""
        tau = np.full(self.batch, self.schedule[k].tau)
        return self._computed(["velocity"], action, tau, self._observation)[0]

    def evaluate(self, action: npt.ArrayLike, tau: npt.ArrayLike, observation: npt.ArrayLike) -> Array:
        """Evaluate at any flow time: action (B, d), tau (B,), observation (B, O) -> (1 + d, B, d)."""
        return self._run(action, tau, observation).copy()

    def _run(self, action: npt.ArrayLike, tau: npt.ArrayLike, observation: npt.ArrayLike) -> Array:
        velocity, jacobian = self._computed(["velocity", "jacobian"], action, tau, observation)
        self._result[0] = velocity
        self._result[1:] = np.moveaxis(jacobian, 2, 0)
        return self._result

    def _computed(
        self, outputs: list[str], action: npt.ArrayLike, tau: npt.ArrayLike, observation: npt.ArrayLike
    ) -> list[Array]:
        inputs = {
            "action": np.asarray(action, np.float32),
            "tau": np.asarray(tau, np.float32)[:, None],
            "observation": np.asarray(observation, np.float32),
        }
        try:
            return self._session.run(outputs, inputs)
        except Exception as error:  # onnxruntime's errors share no other base class
            raise PolicyError(
                f"{self._graph}: cannot be computed for a batch of {self.batch} ({first_line(error)})"
            ) from error


def _open_session(graph: Path) -> _Session:
    try:
        runtime = importlib.import_module("onnxruntime")
    except ImportError as error:
        raise PolicyError(f"{graph}: needs onnxruntime, pip install 'cfpg-edge[onnx]'") from error
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4  # failures arrive as exceptions
    try:
        content = read_regular(graph, LARGEST_FILE)
        session: _Session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors share no other base class
        raise PolicyError(f"{graph}: onnxruntime cannot load it ({first_line(error)})") from error
    return session


def _check_sizes(session: _Session, wanted: dict[str, int], graph: Path) -> None:
    found = {node.name: node.shape[-1] for node in session.get_inputs() if node.shape}
    if found != wanted:
        raise PolicyError(f"{graph}: has inputs {found}, the manifest's fields need {wanted}")
    outputs = {node.name for node in session.get_outputs()}
    if not {"velocity", "jacobian"} <= outputs:
        raise PolicyError(f"{graph}: has outputs {sorted(outputs)}, needs velocity and jacobian")
