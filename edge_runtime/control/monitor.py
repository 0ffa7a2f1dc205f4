"""Keeps count of what a run is judged by: goals, distances, speeds, faults."""

import itertools
import math
from collections import Counter
from typing import Final

from edge_runtime.config.fleet import Fleet
from edge_runtime.control.judgement import SETTLE_S, Judging
from edge_runtime.guidance.guide import Guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import Command, GuidedAction, RobotState, TeamState
from edge_runtime.observation.familiarity import FAMILIAR, Unfamiliar

WAITS: Final = "no own state yet"
"""Why a robot stands of which nothing is known."""


class RobotTally:
    """What one robot, as this process sees it, has done so far."""

    def __init__(self) -> None:
        self.goal_distance_m = math.inf
        self.min_separation_m = math.inf
        self.max_speed_m_s = 0.0
        self.silent_ticks = 0
        """While it was masked: its separations and speeds of that time are not known."""


class Monitor:
    """Follows one run tick by tick.

    Args:
        fleet: the robots and tracked objects with their goals.
        hold_ticks: for how many ticks in a row all that have goals must be there to hold them.
        total_steps: of a complete sample.
        asked: the objectives that the run begins with.
    """

    def __init__(self, fleet: Fleet, hold_ticks: int, total_steps: int, asked: ObjectiveSet) -> None:
        self.robots = {robot.id: RobotTally() for robot in fleet.robots}
        self.faults: Counter[str] = Counter()
        """Ticks that stopped the robot, by reason."""
        self.objective_fault = ""
        """The first fault that was an objective's."""
        self.unfamiliar: Counter[str] = Counter()
        """Ticks whose observation was outside of what training had, by the worst field."""
        self.unfamiliar_now = ""
        """The worst field in the newest tick; empty if all is as in training."""
        self.saw_itself = False
        """Whether the robot's own state was ever known."""
        self.stop_reason = ""
        """Why the newest command is zero; empty while the robot drives."""
        self.withheld = ""
        """Why the bridge kept the newest command back; empty while it does not."""
        self.judged = [Judging(asked)]
        """Each set of objectives so far, over its own time."""
        self.anytime_ticks = 0
        """Ticks whose sample was cut short by the deadline."""
        self._goals = {robot.id: robot.goal_m for robot in fleet.robots if robot.goal_m}
        self.objects = {each.name: math.inf for each in fleet.tracked if each.goal_m}
        """How far each tracked object that has a goal is from it, in m; infinite before it was seen."""
        self._tolerance_m = fleet.team.arrival_m
        self._hold_ticks, self._held = hold_ticks, 0
        self._total_steps = total_steps

    def update(
        self, team: TeamState, guided: GuidedAction, command: Command, unfamiliar: Unfamiliar = FAMILIAR
    ) -> None:
        """Take one tick into account."""
        self.saw_itself = True
        self.unfamiliar_now = unfamiliar.field
        if unfamiliar.field:
            self.unfamiliar[unfamiliar.field] += 1
        states = [team.own, *(mate.state for mate in team.teammates if mate.state.robot_id in self.robots)]
        self._follow_goals(states, team)
        self._measure(states, team)
        if guided.objective_failed and not self.objective_fault:
            self.objective_fault = guided.fault
        self.stop_reason = command.stop_reason
        if command.stop_reason:
            self.faults[command.stop_reason] += 1
        elif guided.steps < self._total_steps:
            self.anytime_ticks += 1

    def no_state(self) -> None:
        """Count a tick in which neither bridge nor pose stream had a state to give."""
        self.stop_reason = WAITS
        self.faults[WAITS] += 1

    def take_over(self, total_steps: int) -> None:
        """Judge samples of another policy from now on, by the number of steps of a complete one."""
        self._total_steps = total_steps

    def judge_anew(self, guide: Guide, now_s: float) -> None:
        """Begin to judge by other objectives, which hold from now on: after `SETTLE_S`."""
        self.judged.append(Judging(guide.asked, guide.version, now_s + SETTLE_S))

    def reached(self, robot_id: int) -> bool:
        """Whether a robot is at its goal now."""
        return self.robots[robot_id].goal_distance_m <= self._tolerance_m

    def has_goal(self, robot_id: int) -> bool:
        """Whether a robot is to be somewhere."""
        return robot_id in self._goals

    @property
    def goals(self) -> int:
        """How many robots and tracked objects have a goal."""
        return len(self._goals) + len(self.objects)

    @property
    def goals_reached(self) -> int:
        """How many of them are there now."""
        there = sum(distance_m <= self._tolerance_m for distance_m in self.objects.values())
        return there + sum(map(self.reached, self._goals))

    @property
    def all_hold(self) -> bool:
        """Whether all that have goals have been there long enough; never where none has."""
        return self._held >= self._hold_ticks

    def _follow_goals(self, states: list[RobotState], team: TeamState) -> None:
        for state in states:
            if goal_m := self._goals.get(state.robot_id):
                self.robots[state.robot_id].goal_distance_m = math.dist(state.position_m, goal_m)
        for each in team.tracked:
            if each.name in self.objects and each.goal_m:
                self.objects[each.name] = math.dist(each.position_m[:2], each.goal_m[:2])
        self._held = self._held + 1 if 0 < self.goals == self.goals_reached else 0

    def _measure(self, states: list[RobotState], team: TeamState) -> None:
        for mate in team.silent:
            self.robots[mate.state.robot_id].silent_ticks += 1
        least, fastest = math.inf, 0.0
        for state in states:
            tally, speed = self.robots[state.robot_id], math.hypot(*state.velocity_m_s)
            tally.max_speed_m_s, fastest = max(tally.max_speed_m_s, speed), max(fastest, speed)
        for state, other in itertools.combinations(states, 2):
            distance = math.dist(state.position_m, other.position_m)
            least = min(least, distance)
            for robot_id in (state.robot_id, other.robot_id):
                tally = self.robots[robot_id]
                tally.min_separation_m = min(tally.min_separation_m, distance)
        self.judged[-1].follow(team, least, fastest)
