"""What is timed: a network, a team and objectives, drawn from a seed."""

from dataclasses import dataclass
from itertools import pairwise

import msgspec
import numpy as np

from edge_runtime.common.arrays import Array, Floats
from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, Mode, ObjectiveSet
from edge_runtime.messages import TeamState
from edge_runtime.motion.model import Model
from edge_runtime.motion.point import PointAcceleration, PointForce
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.weights import Activation, FlowWeights
from export.evaluation.outlook import MotionBatch, TeamBatch

TIME_FEATURES = 16
MODELS: dict[int, Model] = {
    2: PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),
    3: PointAcceleration(drag=0.25, dt_s=0.1, substeps=2, angular=True),
    4: PointAcceleration(drag=0.25, dt_s=0.1, substeps=2, dims=3, angular=True),
}
"""How robots of so many action components move: pushed in the plane, the paper's SE(2), and in space."""


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """The size of one tick; the defaults are the case that every budget is stated for.

    The number of steps is T, of objectives M, of neighbours K.
    """

    layers: tuple[int, ...] = (256, 256, 256)
    observation_dim: int = 32
    action_dim: int = 2
    activation: Activation = "silu"
    steps: int = 10
    objectives: int = 2
    neighbours: int = 3
    batch: int = 1
    sampler: SamplerName = "euler"
    mode: Mode = "hierarchical"
    """The default is the paper's, which all contenders can compute."""

    @property
    def model(self) -> Model:
        """How the robots move."""
        return MODELS[self.action_dim]

    def __str__(self) -> str:
        sizes = f"T={self.steps} M={self.objectives} K={self.neighbours} batch={self.batch}"
        way = f" {self.sampler}" * (self.sampler != "euler") + f" {self.mode}" * (self.mode != "hierarchical")
        return f"{len(self.layers)}x{self.layers[0]} {self.activation} {sizes}{way}"


DEFAULT = Case()


@dataclass(frozen=True)
class Workload:
    """Everything that a contender needs to compute a case's tick."""

    case: Case
    weights: FlowWeights
    observation: Array
    """(B, O)"""
    start: Floats
    """(B, d)"""
    team: TeamBatch
    objectives: tuple[Objective, ...]

    def make_guide(self) -> Guide:
        """The objectives made ready."""
        guidance = GuidanceSettings(mode=self.case.mode, scale=0.5)
        return make_guide(ObjectiveSet(self.objectives, guidance), self.case.model)

    def team_state(self) -> TeamState:
        """The first robot's view of its team."""
        return self.team.row(0)


def random_weights(case: Case, seed: int = 0) -> FlowWeights:
    """A network whose activations keep the size of its inputs, so that nothing saturates or vanishes."""
    rng = np.random.default_rng(seed)

    def matrix(rows: int, columns: int, fan_in: int) -> Array:
        return (rng.standard_normal((rows, columns)) * 1.2 / np.sqrt(fan_in)).astype(np.float32)

    sizes = [*case.layers, case.action_dim]
    inputs = case.action_dim + case.observation_dim + 1 + TIME_FEATURES
    return FlowWeights(
        activation=case.activation,
        action=matrix(case.action_dim, sizes[0], inputs),
        observation=matrix(case.observation_dim, sizes[0], inputs),
        time=matrix(1 + TIME_FEATURES, sizes[0], inputs),
        time_frequency=(np.pi * np.arange(1, 1 + TIME_FEATURES)).astype(np.float32),
        time_phase=np.zeros(TIME_FEATURES, np.float32),
        matrices=tuple(matrix(a, b, a) for a, b in pairwise(sizes)),
        biases=tuple((0.1 * rng.standard_normal(size)).astype(np.float32) for size in sizes),
        prior_std=0.5,
    )


def workload(case: Case, seed: int = 0) -> Workload:
    """Draw a case: robots close together and fast, so that every objective steers in every step."""
    rng = np.random.default_rng(seed)
    batch, dims = case.batch, case.model.dims
    mates = (batch, case.neighbours, dims)
    objectives: list[Objective] = [SpeedLimit(limit_m_s=0.1)]
    objectives += [SafetyMargin(distance_m=0.8 + 0.1 * m) for m in range(1, case.objectives)]
    objectives = objectives[: case.objectives]
    team = TeamBatch(
        robot_id=np.zeros(batch, np.int64),
        own=MotionBatch.of(
            0.2 * rng.standard_normal((batch, dims)), 0.5 * rng.standard_normal((batch, dims))
        ),
        mate_id=np.broadcast_to(1 + np.arange(case.neighbours), mates[:2]),
        mates=MotionBatch.of(0.2 * rng.standard_normal(mates), 0.2 * rng.standard_normal(mates)),
        mate_action=rng.standard_normal((*mates[:2], case.action_dim)),
    )
    return Workload(
        case=case,
        weights=random_weights(case, seed),
        objectives=tuple(objectives),
        observation=rng.standard_normal((batch, case.observation_dim)).astype(np.float32),
        start=np.zeros((batch, case.action_dim)),
        team=team,
    )
