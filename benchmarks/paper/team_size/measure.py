"""How one seed's policy does in one team."""

from collections import Counter
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import torch
from msgspec.structs import replace

from benchmarks.paper.evaluation import commit
from benchmarks.paper.frequency import tick_s
from benchmarks.paper.methods import decider
from benchmarks.paper.oracle.endings import GRACE_STEPS, navigation_kinds
from benchmarks.paper.policies import digest
from benchmarks.paper.settings import Guided
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.team_size.teams import MIXED_KG, TRAINING_ARENA, Team, TeamQuestion, TeamRow
from edge_runtime.common.arrays import Floats
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.policy.adaptation import Adaptation, adapt
from edge_runtime.policy.bundle import Bundle, load_bundle
from export.episodes.bordered import bordered
from export.episodes.judges import Flags, Follower, motion
from export.episodes.neighbourhood import Setting
from export.episodes.play import MakeDecide, play
from export.episodes.some import by_kind, while_running
from export.scenarios.navigation import GOAL_TOLERANCE_M, Navigation
from export.scenarios.scenario import Scenario, Transition

SETTINGS = Guided(
    guidance=GuidanceSettings(scale=0.3, reach=0.5, start_noise=1.0, ease_m=0.1), deconfliction=True
)
"""With the tables' ``ease_m`` and steps for requirements; look-ahead and noise are the built-in teams'."""
EPISODES_SEED = 3
"""Of starts, goals and noise that nothing was chosen by."""


def question(team: Team, seed: int, policy: Path, episodes: int) -> TeamQuestion:
    """What is asked of one seed's policy."""
    plain = replace(SETTINGS, guidance=replace(SETTINGS.guidance, ease_m=0.0))
    return TeamQuestion(
        **msgspec.structs.asdict(team),
        settings=SETTINGS if team.eased else plain,
        seed=seed,
        policy=digest(policy),
        episodes=episodes,
        episodes_seed=EPISODES_SEED,
    )


def measure(asked: TeamQuestion, policy: Path) -> TeamRow:
    """Play and sum up."""
    task, bundle, episodes = TASKS["navigation"], load_bundle(policy), asked.episodes
    make_decide = team_decider(asked, asked.settings, bundle)
    setting = Setting(episodes=episodes, episodes_seed=asked.episodes_seed, neighbours=asked.neighbours)
    world, follower = make_world(asked, episodes, asked.episodes_seed), _Follower(episodes)
    _play(world, make_decide, follower, setting, asked.steps)
    outcome, at_goal = follower.judge.outcome(), _at_goal(world)
    at_goal[~follower.running] = 1.0
    kinds = navigation_kinds(world, follower.judge, partial(_play_on, world, make_decide, setting))
    missed = Counter(kinds[number] for number in np.flatnonzero(~outcome.satisfied))
    took = 0.1 * follower.steps[outcome.satisfied]
    return TeamRow(
        **msgspec.structs.asdict(asked),
        commit=commit(),
        success=100.0 * float(outcome.satisfied.mean()),
        at_goal=100.0 * float(at_goal.mean()),
        contact=100.0 * float(follower.touched.mean()),
        speeding=100.0 * float(outcome.first.mean()),
        margin=100.0 * float(outcome.second.mean()),
        time_to_goal_s=float(took.mean()) if len(took) else None,
        failures={kind: 100.0 * count / episodes for kind, count in sorted(missed.items())},
        tick_us=1e6 * tick_s(task, bundle, _heard(asked)),
    )


def make_world(team: Team, episodes: int, episodes_seed: int) -> Navigation:
    """The team's starts."""
    return Navigation(
        episodes,
        10_000 * episodes_seed,
        torch.device("cpu"),
        training=False,
        robots=team.robots,
        half_width_m=team.half_width_m,
        masses_kg=team.masses_kg,
    )


def team_decider(team: Team, settings: Guided, bundle: Bundle) -> MakeDecide:
    """What a team's robots decide, each by its own mass if it is told it; the policy stays as it is."""

    def own(policy: Bundle) -> MakeDecide:
        arena = TRAINING_ARENA if team.near else None
        return bordered(decider(TASKS["navigation"], settings, policy), policy.manifest, arena)

    if not team.mixed or not team.told:
        return own(bundle)
    adapted = [own(adapt(bundle, Adaptation(mass_kg=mass_kg))) for mass_kg in MIXED_KG]
    return by_kind(adapted, [MIXED_KG.index(mass_kg) for mass_kg in team.masses_kg])


class _Follower:
    """The task's judge, and what it does not tell."""

    def __init__(self, episodes: int) -> None:
        self.judge = TASKS["navigation"].judge(episodes)
        self.running: Flags = np.ones(episodes, bool)
        self.steps, self.touched = np.zeros(episodes), np.zeros(episodes, bool)

    def add(self, world: Scenario, transition: Transition) -> None:
        self.steps += self.running
        self.touched |= self.running & transition.failed.numpy()
        self.judge.add(world, transition)
        self.running = self.judge.running


def _play(
    world: Navigation, make_decide: MakeDecide, follower: Follower, setting: Setting, steps: int
) -> None:
    play(
        world, while_running(make_decide, follower), follower, setting, steps, 10_000 * setting.episodes_seed
    )


def _play_on(world: Navigation, make_decide: MakeDecide, setting: Setting) -> Flags:
    late = TASKS["navigation"].judge(world.environments)
    _play(world, make_decide, late, setting, GRACE_STEPS)
    return late.outcome().satisfied


def _at_goal(world: Navigation) -> Floats:
    """Share of the robots at their goals, (E,)."""
    position, _ = motion(world)
    goal = world.state_dict()["goal"].double().numpy()
    return (np.linalg.norm(position - goal, axis=-1) < GOAL_TOLERANCE_M).mean(1)


def _heard(team: Team) -> int:
    """Neighbours that guidance hears of."""
    return team.robots - 1 if team.neighbours is None else min(team.neighbours, team.robots - 1)
