"""Eqs. 14 and 15 over a whole team's joint action, as the paper writes them, instead of robot by robot.

A conflict then counts where the team as a whole has one: a robot may oppose its own flow, or another of its
objectives, if the rest of the team outweighs it. It takes everybody's gradients at one place, which robots
that decide on their own do not have: for comparison only.
"""

from edge_runtime.common.arrays import Floats
from export.evaluation.projection import BatchCombine


def combine_teams(
    combine: BatchCombine, robots: int, gradients: Floats, factors: Floats, nominal: Floats
) -> Floats:
    """Project E teams of N robots, a team's in consecutive rows: (M, E N, d), (M,), (E N, d) -> (E N, d)."""
    count, rows, size = gradients.shape
    teams = (rows // robots, robots * size)
    joint = combine(gradients.reshape(count, *teams), factors, nominal.reshape(teams))
    return joint.reshape(rows, size)
