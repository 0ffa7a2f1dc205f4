"""Teams of one robot's view each, as evaluation takes them."""

import numpy as np

from export.evaluation.outlook import MotionBatch, TeamBatch


def _motion(state):
    return [*state.position_m, *state.velocity_m_s, state.heading_rad, state.yaw_rate_rad_s]


def moving(values) -> MotionBatch:
    dims = values.shape[-1] // 2 - 1
    return MotionBatch(values[..., :dims], values[..., dims:-2], values[..., -2], values[..., -1])


def as_batch(teams) -> TeamBatch:
    def mates(read):
        return np.array([[read(mate) for mate in team.teammates] for team in teams])

    return TeamBatch(
        robot_id=np.array([team.own.robot_id for team in teams]),
        own=moving(np.array([_motion(team.own) for team in teams])),
        mate_id=mates(lambda m: m.state.robot_id),
        mates=moving(mates(lambda m: _motion(m.state))),
        mate_action=mates(lambda m: m.intended_action),
        tracked={
            name: moving(np.array([_motion(each) for each in seen]))
            for name, seen in _by_name(team.tracked for team in teams).items()
        },
        left_m=_left(teams),
    )


def _left(teams):
    """How far what has a goal is from it, if anything has one."""
    ways = [
        [np.subtract(each.position_m, each.goal_m) for each in team.tracked if each.goal_m] for team in teams
    ]
    return np.linalg.norm(ways, axis=-1).max(1) if all(ways) else None


def _by_name(tracked):
    """What each team sees of every object."""
    rows = list(tracked)
    return {each.name: [row[place] for row in rows] for place, each in enumerate(rows[0])}
