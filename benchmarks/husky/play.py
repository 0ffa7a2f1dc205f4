"""Episodes on wheels: every robot decides on what it observes, as its own computer would."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from benchmarks.husky.cases import ASKED, TASK, Case, settings_of, task_of
from benchmarks.husky.teams import Places, Teams, drawn
from benchmarks.paper.methods import decider
from edge_runtime.common.arrays import Array, Floats
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.bundle import Bundle, packaged_bundle
from export.evaluation.outlook import TeamBatch
from firmware_bridge.simulation.wheels.bases import BASES

EPISODE_S: Final = {4: 40.0, 16: 80.0}
"""Longest, by the number of robots."""
HOLD_S: Final = 1.0
GOAL_TOLERANCE: Final = 0.1
"""In the policy's metres, as the paper has it."""
SAMPLE_S: Final = 0.02
"""Speeds and distances are looked at so often, not only when robots decide."""


class Ends(NamedTuple):
    """What came of E episodes until all had arrived, (E,) each; speeds, distances in the robots' metres."""

    arrival_s: Floats
    """Infinite where not everybody held its goal."""
    touched: Floats
    speeding: Floats
    """Shares of the time in which anybody was faster than the limit, or nearer than the margin."""
    near: Floats
    fastest_m_s: Floats
    nearest_m: Floats


Watch = Callable[[Teams], None]
"""Looks on, once before every decision."""


def play(case: Case, bundle: Bundle, seeds: Sequence[int], watch: Watch = lambda _teams: None) -> Ends:
    """Run the episodes of these seeds side by side.

    Args:
        case: who drives where, and how it decides.
        bundle: the policy.
        seeds: of starts, goals and headings; the first one, of noise.
        watch: looks on.
    """
    asked, places = ASKED[case.base], drawn(seeds, case.robots)
    teams = Teams(BASES[case.base], asked.scale_m, places, case.friction)
    observe = Observing(places, packaged_bundle(TASK))
    decide = decider(task_of(case.base), settings_of(case.method), bundle)(teams.count * teams.robots)
    judge, draw = Judge(case, places.goals), np.random.default_rng(seeds[0])
    action, motion = np.zeros_like(teams.velocity), bundle.manifest.motion
    period_s, step = motion.dt_s, motion.preview(1)
    for _ in range(round(EPISODE_S[case.robots] / period_s)):
        watch(teams)
        views = TeamBatch.of_teams(teams.position, teams.velocity, action)
        action = np.clip(decide(observe(teams), views, draw), -1.0, 1.0).reshape(action.shape)
        told = teams.told(step.velocity_decay * teams.velocity + step.velocity_gain * action)
        for _ in range(round(period_s / SAMPLE_S)):
            teams.world.step(told, SAMPLE_S)
            teams.look()
            judge.add(teams)
        if not judge.running.any():
            break
    return judge.ends(teams)


class Observing:
    """Composes the observations (B, O) of all robots as each composes its own."""

    def __init__(self, places: Places, bundle: Bundle) -> None:
        goals = places.goals.reshape(-1, 2).tolist()
        self._observers = [Observer(bundle.manifest, (x, y)) for x, y in goals]
        self._size = bundle.manifest.observation_dim

    def __call__(self, teams: Teams) -> Array:
        """Look at the teams as they are now."""
        rows = np.zeros((len(self._observers), self._size), np.float32)
        for team in range(teams.count):
            places, speeds = teams.position[team].tolist(), teams.velocity[team].tolist()
            states = [
                RobotState(i, 0.0, tuple(p), tuple(v))
                for i, (p, v) in enumerate(zip(places, speeds, strict=True))
            ]
            mates = [Teammate(state) for state in states]
            for robot, state in enumerate(states):
                row, view = (
                    team * teams.robots + robot,
                    TeamState(state, tuple(mates[:robot] + mates[robot + 1 :])),
                )
                rows[row] = self._observers[row].observe(view)[0]
        return rows


class Judge:
    """Follows episodes until everybody has held its goal.

    Args:
        case: what is asked.
        goals: (E, N, 2), in the policy's metres.
    """

    def __init__(self, case: Case, goals: Floats) -> None:
        self._asked, self._goals = ASKED[case.base], goals
        count = len(goals)
        self._arrival, self._since = np.full(count, np.inf), np.full(count, np.inf)
        self._fastest, self._nearest = np.zeros(count), np.full(count, np.inf)
        self._speeding, self._near, self._samples = np.zeros(count), np.zeros(count), np.zeros(count)
        self._now_s = 0.0

    @property
    def running(self) -> Floats:
        """Which episodes (E,) are not over."""
        return np.isinf(self._arrival)

    def add(self, teams: Teams) -> None:
        """Look at the teams once more."""
        self._now_s += SAMPLE_S
        unit, running = self._asked.scale_m, self.running
        speed = unit * np.linalg.norm(teams.velocity, axis=-1).max(-1)
        apart = teams.position[:, :, None] - teams.position[:, None]
        distance = np.linalg.norm(apart, axis=-1) + np.diag(np.full(teams.robots, np.inf))
        nearest = unit * distance.min((1, 2))
        self._samples += running
        self._speeding += running & (speed > self._asked.limit_m_s)
        self._near += running & (nearest < self._asked.margin_m)
        self._fastest = np.where(running, np.maximum(self._fastest, speed), self._fastest)
        self._nearest = np.where(running, np.minimum(self._nearest, nearest), self._nearest)
        away = np.linalg.norm(teams.position - self._goals, axis=-1).max(-1)
        self._since = np.where(away <= GOAL_TOLERANCE, np.minimum(self._since, self._now_s), np.inf)
        held = running & (self._now_s - self._since >= HOLD_S)
        self._arrival = np.where(held, self._since, self._arrival)

    def ends(self, teams: Teams) -> Ends:
        """What came of it."""
        shares = self._speeding / self._samples, self._near / self._samples
        return Ends(self._arrival, teams.touched(), *shares, self._fastest, self._nearest)
