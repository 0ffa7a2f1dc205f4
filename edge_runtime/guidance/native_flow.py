"""The guided flow where a policy takes all its steps at once, as the compiled kernel does."""

import time

from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.reach import reach_now
from edge_runtime.guidance.slopes import ObjectiveError, action_slope, not_finite
from edge_runtime.messages import GuidedAction, TeamState, Vector, Vector2
from edge_runtime.motion.outlook import Outlook, later
from edge_runtime.policy.velocity_field import Sampler, Sight


def native_flow(
    sampler: Sampler,
    team: TeamState,
    obstacles: tuple[Vector2, ...],
    guide: Guide,
    start: Vector,
    deadline_s: float,
    most_steps: int,
) -> GuidedAction:
    """Sample an action, corrected as the guide asks; the observation is set already."""
    own = _OwnObjectives(guide, team, obstacles)
    mates = team.teammates + team.silent
    sight = Sight(len(mates), len(obstacles), len(guide.tracked))
    left_s = deadline_s - time.monotonic()
    sample = sampler.sample(
        guide.steering, sight, _view(team, obstacles, guide), start, left_s, most_steps, own.slope
    )
    if sample.fault >= 0:
        fault = own.fault or str(not_finite(guide.objectives[sample.fault]))
        rest = (0.0,) * len(start)
        return GuidedAction(
            sample.action, sample.steps, fault=fault, correction=rest, cut=sample.cut, objective_failed=True
        )
    return GuidedAction(
        sample.action,
        sample.steps,
        sample.costs,
        sample.projections,
        "",
        sample.conflicts,
        sample.opposed,
        sample.correction,
        sample.cut,
    )


def _view(team: TeamState, obstacles: tuple[Vector2, ...], guide: Guide) -> list[float]:
    """What the robot sees in plain numbers, see `Sampler.sample`."""
    own = team.own
    view: list[float] = [own.robot_id, *own.position_m, *own.velocity_m_s]
    for point in obstacles:
        view += point
    for name in guide.tracked:
        view += _tracked(team, name, guide.steering.dims)
    for mate in team.teammates + team.silent:
        state = mate.state
        view.append(state.robot_id)
        view += state.position_m
        view += state.velocity_m_s
        view += mate.intended_action
    view.append(reach_now(guide.asked.guidance, team.tracked))
    return view


def _tracked(team: TeamState, name: str, dims: int) -> tuple[float, ...]:
    """One tracked object's numbers; zeros where it is not there."""
    for each in team.tracked:
        if each.name == name:
            now = later(each, 0.0, dims)
            height, climb = ((now.z,), (now.vz,)) if dims == 3 else ((), ())
            return (1.0, now.x, now.y, *height, now.vx, now.vy, *climb)
    return (0.0,) * (1 + 2 * dims)


class _OwnObjectives:
    """Computes the objectives that the sampler leaves to Python, in one tick."""

    def __init__(self, guide: Guide, team: TeamState, obstacles: tuple[Vector2, ...]) -> None:
        self._guide, self._team, self._obstacles = guide, team, obstacles
        self._outlooks: dict[int, Outlook] = {}
        self.fault = ""
        """What one of them did wrong."""

    def slope(self, place: int, action: Vector) -> tuple[float, Vector] | None:
        """See `edge_runtime.policy.velocity_field.OwnSlope`."""
        if place not in self._outlooks:
            self._outlooks[place] = self._guide.outlook(place, self._team, self._obstacles)
        try:
            return action_slope(self._guide.objectives[place], self._outlooks[place], action)
        except ObjectiveError as error:
            self.fault = str(error)
            return None
