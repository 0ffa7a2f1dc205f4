"""The paper's evaluation: its judges by hand, its baselines by their definitions, its rows and statistics."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy import stats

from benchmarks.paper import evaluation
from benchmarks.paper import paper_command as command
from benchmarks.paper.baselines import DescentSettings, ShieldSettings, descend, shield
from benchmarks.paper.candidates import METHODS, SCALES, candidates, scaled
from benchmarks.paper.contestants import FLOWS, ours
from benchmarks.paper.episodes import Setting, run_episodes
from benchmarks.paper.evaluation import Question
from benchmarks.paper.judges import BalanceJudge, NavigationJudge, SamplingJudge, cluster_radius
from benchmarks.paper.methods import guided, unguided
from benchmarks.paper.neighbourhood import Neighbourhood
from benchmarks.paper.policies import POLICIES
from benchmarks.paper.rows import Key, make_row, read_rows, write_rows
from benchmarks.paper.statistics import equivalence, summarise, welch
from benchmarks.paper.tables import success_table
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import Tried, chosen
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from export.evaluation.guidance import action_slopes
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import look_ahead_batch
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING
from export.scenarios.scenario import Transition

DYNAMICS = Dynamics(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2)
SOMEBODY = ours(TASKS["navigation"], GuidanceSettings(scale=0.3, reach=0.5, start_noise=0.5))
MODE = "terminal, eta 0.3, noise 0.5, reach 0.5"


@dataclass
class World:
    """A scenario that stands where it is put."""

    position: np.ndarray
    velocity: np.ndarray | None = None
    amount: float = 0.0

    def motion(self):
        velocity = np.zeros_like(self.position) if self.velocity is None else self.velocity
        return torch.tensor(self.position), torch.tensor(velocity)

    def nominal(self):
        return torch.full((len(self.position),), self.amount)


def transition(*, succeeded=False, failed=False, episodes=1):
    flags = [torch.full((episodes,), flag) for flag in (succeeded, failed, False)]
    return Transition(torch.zeros(episodes, 1), *flags)


def line(*x, y=0.0):
    return np.array([[[value, y] for value in x]], float)


def test_navigation_counts_speeding_robots_and_steps_inside_the_margin_until_all_have_arrived():
    judge = NavigationJudge(1, NAVIGATION)
    fast = np.array([[[0.31, 0.0], [0.1, 0.0], [0.0, 0.0], [0.0, 0.4]]])
    judge.add(World(line(0, 1, 2, 3), fast), transition())
    judge.add(World(line(0, 0.2, 2, 3)), transition(succeeded=True))
    judge.add(World(line(0, 0.1, 2, 3), fast), transition(failed=True))
    outcome = judge.outcome()
    assert (outcome.nominal[0], outcome.first[0], outcome.second[0]) == (1.0, 0.25, 0.5)
    assert not outcome.satisfied[0]


def test_navigation_is_not_satisfied_by_an_arrival_after_a_collision():
    judge = NavigationJudge(1, NAVIGATION)
    judge.add(World(line(0, 1, 2, 3)), transition(failed=True))
    judge.add(World(line(0, 1, 2, 3)), transition(succeeded=True))
    outcome = judge.outcome()
    assert outcome.nominal[0] == 0.0
    assert not outcome.satisfied[0]


def balanced(order):
    """Robots at the wanted spacing, from left to right in an order."""
    x = np.empty(5)
    x[list(order)] = BALANCE.spacing.distance_m * np.arange(5)
    return line(*x)


@pytest.mark.parametrize(
    ("order", "on_goal", "satisfied"),
    [((1, 0, 3, 2, 4), True, True), ((1, 0, 3, 2, 4), False, False), ((0, 1, 2, 3, 4), True, False)],
)
def test_balance_asks_for_goal_order_and_spacing_at_one_moment(order, on_goal, satisfied):
    judge = BalanceJudge(1, BALANCE)
    judge.add(World(balanced(order), amount=0.1), transition(succeeded=on_goal))
    outcome = judge.outcome()
    assert outcome.satisfied[0] == satisfied
    assert judge.running[0] == (not satisfied)
    assert outcome.first[0] == (order != BALANCE.spatial_order.order)
    assert outcome.nominal[0] == pytest.approx(0.1)


def test_balance_is_over_when_the_payload_falls():
    judge = BalanceJudge(1, BALANCE)
    judge.add(World(balanced(range(5)), amount=1.0), transition(failed=True))
    judge.add(World(balanced(BALANCE.spatial_order.order)), transition(succeeded=True))
    assert judge.outcome().nominal[0] == 1.0
    assert not judge.outcome().satisfied[0]


def test_balance_spacing_is_judged_by_each_robots_closest_neighbour():
    judge = BalanceJudge(1, BALANCE)
    apart = balanced(BALANCE.spatial_order.order)
    apart[0, 4, 0] += BALANCE.spacing_tolerance_m + 0.01
    judge.add(World(apart), transition(succeeded=True))
    assert not judge.outcome().satisfied[0]


def test_sampling_sums_up_samples_fence_and_cluster():
    radius = SAMPLING.clustering.radius_m
    angles = 2 * math.pi * np.arange(3) / 3
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], -1)[None]
    assert cluster_radius(ring)[0] == pytest.approx(radius)
    judge = SamplingJudge(1, SAMPLING)
    judge.add(World(ring + 1.0, amount=10.0), transition())
    judge.add(World(ring * 1.5 + 1.0, amount=SAMPLING.enough_samples), transition())
    outcome = judge.outcome()
    assert outcome.nominal[0] == SAMPLING.enough_samples
    assert outcome.first[0] == 0.0
    assert outcome.second[0] == pytest.approx(0.5 * radius / math.sqrt(2))
    judge.add(World(ring * 0.1, amount=SAMPLING.enough_samples), transition())
    assert judge.outcome().first[0] == pytest.approx(1 / 3)


def views(position, velocity, neighbours=None, loss=0.0, draw=None):
    episodes, robots, _ = position.shape
    hood = Neighbourhood(episodes, robots, neighbours, loss, draw or np.random.default_rng(0))
    return hood.views(position, velocity, np.zeros_like(position))


def test_robots_hear_of_their_nearest_neighbours_only():
    seen = views(line(0.0, 1.0, 3.0, 7.0), np.zeros((1, 4, 2)), neighbours=2)
    assert seen.mate_id.tolist() == [[1, 2], [0, 2], [1, 0], [2, 1]]
    assert seen.mate_position_m[0, :, 0].tolist() == [1.0, 3.0]


def test_a_lost_message_leaves_what_was_heard_last():
    hood = Neighbourhood(1, 2, None, 1.0, np.random.default_rng(0))
    still = np.zeros((1, 2, 2))
    hood.views(line(0.0, 1.0), still, still)
    later = hood.views(line(5.0, 6.0), still, still)
    assert later.position_m[:, 0].tolist() == [5.0, 6.0]
    assert later.mate_position_m[:, 0, 0].tolist() == [1.0, 0.0]


def scene(count=200, seed=0):
    """Random actions of one robot amid three, their guide and what it sees."""
    draw = np.random.default_rng(seed)
    guide = make_guide(
        ObjectiveSet(
            (SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)),
            GuidanceSettings(mode="none", scale=1.0),
        ),
        DYNAMICS,
    )
    seen = views(draw.uniform(-0.4, 0.4, (count, 4, 2)), draw.uniform(-0.3, 0.3, (count, 4, 2)))
    outlooks = [look_ahead_batch(seen, preview) for preview in guide.previews]
    return draw.uniform(-1, 1, (4 * count, 2)), guide, outlooks


def costs(action, guide, outlooks):
    total = np.zeros(len(action))
    for objective, outlook in zip(guide.objectives, outlooks, strict=True):
        preview = outlook.preview
        total += evaluate_batch(
            objective,
            outlook.drift_position_m + preview.position_gain * action,
            outlook.drift_velocity_m_s + preview.velocity_gain * action,
            outlook,
        ).cost
    return total


def test_projected_descent_lowers_the_costs_and_stays_near_the_policys_action():
    action, guide, outlooks = scene()
    settings = DescentSettings(radius=0.4, rate=0.1)
    moved = descend(settings, action, guide, outlooks)
    assert (np.linalg.norm(moved - action, axis=1) <= settings.radius + 1e-9).all()
    before, after = costs(action, guide, outlooks), costs(moved, guide, outlooks)
    assert (after <= before + 1e-9).mean() > 0.99
    assert np.array_equal(moved[before == 0.0], action[before == 0.0])


def test_a_shield_reaches_the_safe_set_of_one_objective_at_the_nearest_action():
    guide = make_guide(
        ObjectiveSet((SpeedLimit(limit_m_s=0.3, buffer_m_s=0.0),), GuidanceSettings(mode="none", scale=1.0)),
        DYNAMICS,
    )
    seen = views(np.zeros((1, 1, 2)), np.array([[[0.5, 0.0]]]))
    outlooks = [look_ahead_batch(seen, preview) for preview in guide.previews]
    action = np.array([[1.0, 0.0]])
    moved = shield(ShieldSettings(rounds=3), action, guide, outlooks)
    gain, drift = guide.previews[0].velocity_gain, outlooks[0].drift_velocity_m_s[0, 0]
    assert drift + gain * moved[0, 0] == pytest.approx(0.3)
    assert np.abs(action_slopes(guide, outlooks, moved)).max() < 1e-6


def test_a_shield_leaves_safe_actions_alone():
    action, guide, outlooks = scene()
    moved = shield(ShieldSettings(rounds=20), action, guide, outlooks)
    safe = costs(action, guide, outlooks) == 0.0
    assert safe.any()
    assert np.array_equal(moved[safe], action[safe])


def test_guided_episodes_keep_the_limits_that_unguided_ones_break():
    task, bundle = TASKS["navigation"], packaged_bundle("navigation")
    setting = Setting(episodes=4, seed=5)
    free = run_episodes(task, unguided(bundle, 1.0), setting)
    steered = run_episodes(task, guided(GuidanceSettings(), task.objectives, bundle), setting)
    assert free.first.min() > 0.05
    assert steered.first.max() == 0.0


def test_every_method_may_be_tuned_over_as_many_settings():
    for task in TASKS.values():
        for method in METHODS:
            modes = [candidate.mode for candidate in candidates(task, method)]
            assert len(set(modes)) == 8


def test_a_contestant_is_named_by_all_that_was_tuned():
    assert (SOMEBODY.method, SOMEBODY.mode, SOMEBODY.algorithm) == ("CFPG", MODE, FLOWS["navigation"])
    (literal, *_) = candidates(TASKS["navigation"], "CFPG (eqs. 14, 15)")
    assert literal.mode == "hierarchical, eta 0.3, noise 1"  # reach means nothing there
    assert candidates(TASKS["balance"], "CFPG")[0].algorithm == "mafpo-warm"


def test_every_scale_of_the_sweep_keeps_the_other_settings_and_only_flows_have_one():
    swept = scaled(TASKS["navigation"], SOMEBODY)
    assert [who.mode for who in swept] == [MODE.replace("0.3", f"{scale:g}") for scale in SCALES]
    with pytest.raises(ValueError, match="PC-MAPPO has no guidance scale"):
        scaled(TASKS["navigation"], candidates(TASKS["navigation"], "PC-MAPPO")[0])


def some_row(seed=0, success=50.0, method="CFPG"):
    key = Key("navigation", method, MODE, seed, 10, 1, None, None, 0.0, "policy", "definitions")
    outcome = run_outcome(success)
    return make_row(TASKS["navigation"], outcome, key, "commit")


def run_outcome(success):
    judge = NavigationJudge(2, NAVIGATION)
    judge.add(World(np.tile(line(0, 1, 2, 3), (2, 1, 1))), transition(succeeded=success > 0, episodes=2))
    return judge.outcome()


def test_rows_come_back_as_written_and_know_their_question(tmp_path):
    path = tmp_path / "paper.json"
    rows = [some_row(0), some_row(1)]
    write_rows(path, rows)
    assert read_rows(path) == rows
    assert rows[0].key != rows[1].key
    assert rows[0].navigation_success == rows[0].multi_objective_success == 100.0
    assert rows[0].payload_distance is None
    few = rows[0].key._replace(neighbours=3)
    lossy = rows[0].key._replace(loss=0.2)
    kept = [make_row(TASKS["navigation"], run_outcome(0.0), key, "commit") for key in (few, lossy)]
    write_rows(path, [*rows, *kept])
    assert [row.key for row in read_rows(path)] == [rows[0].key, rows[1].key, few, lossy]
    assert len({row.key for row in read_rows(path)}) == 4


@pytest.mark.parametrize("content", [b"{}", b"[{}]", b"no json"])
def test_a_foreign_file_is_not_overwritten(tmp_path, content):
    path = tmp_path / "paper.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="holds no rows of this benchmark"):
        read_rows(path)


def test_finished_rows_are_not_asked_again(monkeypatch, tmp_path):
    row = some_row()
    monkeypatch.setattr(evaluation, "key", lambda _question, _policies: row.key)
    question = Question("navigation", SOMEBODY, 0, 10)
    assert list(evaluation.answer_all([question], tmp_path, 1, [row])) == []


def test_rows_of_other_episodes_answer_nothing(monkeypatch):
    question, root = Question("navigation", SOMEBODY, 0, 10), POLICIES
    before = evaluation.key(question, root)
    monkeypatch.setattr(evaluation, "EVALUATION_SEED", evaluation.EVALUATION_SEED + 1)
    assert evaluation.key(question, root) == before._replace(episodes_seed=before.episodes_seed + 1)


def test_a_missing_seed_is_one_clear_line(tmp_path):
    question = Question("navigation", SOMEBODY, 3, 10)
    with pytest.raises(ConfigError, match=r"no bundle of mafpo-chain on navigation with seed 3; make"):
        evaluation.key(question, tmp_path)


def test_tuning_that_never_happened_is_named():
    with pytest.raises(ConfigError, match="CFPG was not tuned on navigation"):
        chosen([Tried("navigation", "CFPG", MODE, 1.0, 1.0)], TASKS["navigation"], "CFPG")
    marked = [Tried("navigation", "CFPG", MODE, 1.0, 1.0, chosen=True)]
    assert chosen(marked, TASKS["navigation"], "CFPG").mode == MODE


def test_statistics_over_seeds():
    ours, theirs = [90.0, 91.0, 92.0, 93.0, 94.0], [80.0, 84.0, 83.0, 82.0, 81.0]
    assert str(summarise(ours)) == "92.0 ± 1.6"
    assert welch(ours, theirs) == stats.ttest_ind(ours, theirs, equal_var=False).pvalue
    assert equivalence(ours, theirs) > 0.5
    assert equivalence(ours, [value + 0.5 for value in ours]) < 0.01
    assert math.isnan(welch(ours, [1.0]))
    assert welch([0.0, 0.0], [0.0, 0.0]) == 1.0


def test_the_success_table_shows_what_was_not_run():
    table = success_table([some_row(0), some_row(1)])
    assert "| CFPG | 100.0 ± 0.0 (88.7) | not run | not run |" in table


def test_wrong_flags_are_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["--tasks", "chess"])
    assert "invalid choice: 'chess'" in capsys.readouterr().err
