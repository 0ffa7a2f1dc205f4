"""How often one robot could decide on this machine: Fig. 7's other axis, and what larger teams cost."""

import time

import numpy as np

from benchmarks.paper.tasks import Task
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.policy.bundle import Bundle

TICKS = 200


def control_frequency(task: Task, bundle: Bundle) -> float:
    """One over the median processor time of a guided tick of the numpy runtime, in Hz."""
    return 1.0 / tick_s(task, bundle, 3)


def tick_s(task: Task, bundle: Bundle, mates: int) -> float:
    """Median processor time of one robot's guided tick, on the numpy runtime.

    Args:
        task: whose objectives guide.
        bundle: the policy.
        mates: teammates, so close that the team's objectives are at work.
    """
    policy = bundle.policy()
    guide = make_guide(ObjectiveSet(task.objectives), bundle.manifest.motion)
    observation = np.zeros((1, policy.observation_dim), np.float32)
    around = [Teammate(RobotState(k, 0.0, (0.1 * k, 0.1), (0.2, 0.0))) for k in range(1, mates + 1)]
    team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.5, 0.0)), tuple(around))
    durations = []
    for _ in range(TICKS):
        begin = time.thread_time()
        guided_action(policy, observation, team, guide)
        durations.append(time.thread_time() - begin)
    return float(np.median(durations))
