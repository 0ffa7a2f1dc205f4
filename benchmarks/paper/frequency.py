"""How often one robot could decide on this machine, with T Euler steps: Fig. 7's other axis."""

import time

import numpy as np

from benchmarks.paper.tasks import Task
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.numpy_policy import FlowPolicy

TICKS = 200


def control_frequency(task: Task, bundle: Bundle, euler_steps: int) -> float:
    """One over the median duration of a guided tick of the numpy runtime, in Hz."""
    policy = FlowPolicy(bundle.weights, euler_steps) if bundle.weights else bundle.policy(1, euler_steps)
    guide = make_guide(ObjectiveSet(task.objectives), bundle.manifest.motion)
    observation = np.zeros((1, policy.observation_dim), np.float32)
    # Close enough to each other for the team's objectives to be at work.
    mates = [Teammate(RobotState(k, 0.0, (0.1 * k, 0.1), (0.2, 0.0))) for k in range(1, 4)]
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.5, 0.0)), tuple(mates))
    durations = []
    for _ in range(TICKS):
        begin = time.perf_counter()
        guided_action(policy, observation, team, guide)
        durations.append(time.perf_counter() - begin)
    return float(1.0 / np.median(durations))
