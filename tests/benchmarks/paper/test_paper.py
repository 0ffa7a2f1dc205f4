"""The paper's evaluation: its judges by hand, its baselines by their definitions, its rows and statistics."""

import math
import shutil
from dataclasses import dataclass
from itertools import product

import msgspec
import numpy as np
import pytest
import torch
from msgspec import structs
from scipy import stats

from benchmarks.common.flags import POLICIES
from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper import evaluation
from benchmarks.paper import paper_command as command
from benchmarks.paper.baselines import descend, shield
from benchmarks.paper.candidates import METHODS, SCALES, candidates, scaled
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.policies import SEEDS, find_policy
from benchmarks.paper.possible import Ended
from benchmarks.paper.rows import Key, Question, Row, make_row
from benchmarks.paper.settings import UNGUIDED, Descent, Guided, Mean, Shield
from benchmarks.paper.statistics import equivalence, paired, paired_equivalence, summarise, welch
from benchmarks.paper.tables import share_table, success_table
from benchmarks.paper.tasks import TASKS
from benchmarks.paper.tuning import Tried, chosen, read_tuned
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.judges import BalanceJudge, NavigationJudge, SamplingJudge, cluster_radius
from export.episodes.neighbourhood import Neighbourhood, Setting
from export.evaluation.guidance import action_slopes
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import look_ahead_batch
from export.scenarios.definitions import BALANCE, NAVIGATION, SAMPLING
from export.scenarios.scenario import Transition

DYNAMICS = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2)
SETTINGS = Guided(guidance=GuidanceSettings(scale=0.3, reach=0.5, start_noise=0.5), deconfliction=True)


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
    judge = NavigationJudge(NAVIGATION, 1)
    fast = np.array([[[0.31, 0.0], [0.1, 0.0], [0.0, 0.0], [0.0, 0.4]]])
    judge.add(World(line(0, 1, 2, 3), fast), transition())
    judge.add(World(line(0, 0.2, 2, 3)), transition(succeeded=True))
    judge.add(World(line(0, 0.1, 2, 3), fast), transition(failed=True))
    outcome = judge.outcome()
    assert (outcome.nominal[0], outcome.first[0], outcome.second[0]) == (1.0, 0.25, 0.5)
    assert not outcome.satisfied[0]


def test_navigation_is_not_satisfied_by_an_arrival_after_a_collision():
    judge = NavigationJudge(NAVIGATION, 1)
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
    judge = BalanceJudge(BALANCE, 1)
    judge.add(World(balanced(order), amount=0.1), transition(succeeded=on_goal))
    outcome = judge.outcome()
    assert outcome.satisfied[0] == satisfied
    assert judge.running[0] == (not satisfied)
    assert outcome.first[0] == (order != BALANCE.spatial_order.order)
    assert outcome.nominal[0] == pytest.approx(0.1)


def test_balance_is_over_when_the_payload_falls():
    judge = BalanceJudge(BALANCE, 1)
    judge.add(World(balanced(range(5)), amount=1.0), transition(failed=True))
    judge.add(World(balanced(BALANCE.spatial_order.order)), transition(succeeded=True))
    assert judge.outcome().nominal[0] == 1.0
    assert not judge.outcome().satisfied[0]


def test_balance_spacing_is_judged_by_each_robots_closest_neighbour():
    judge = BalanceJudge(BALANCE, 1)
    apart = balanced(BALANCE.spatial_order.order)
    apart[0, 4, 0] += BALANCE.spacing_tolerance_m + 0.01
    judge.add(World(apart), transition(succeeded=True))
    assert not judge.outcome().satisfied[0]


def test_sampling_sums_up_samples_fence_and_cluster():
    radius = SAMPLING.clustering.radius_m
    angles = 2 * math.pi * np.arange(3) / 3
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], -1)[None]
    assert cluster_radius(ring)[0] == pytest.approx(radius)
    judge = SamplingJudge(SAMPLING, 1)
    judge.add(World(ring + 1.0, amount=10.0), transition())
    judge.add(World(ring * 1.5 + 1.0, amount=SAMPLING.enough_samples), transition())
    outcome = judge.outcome()
    assert outcome.nominal[0] == SAMPLING.enough_samples
    assert outcome.first[0] == 0.0
    assert outcome.second[0] == pytest.approx(0.5 * radius / math.sqrt(2))
    judge.add(World(ring * 0.1, amount=SAMPLING.enough_samples), transition())
    assert judge.outcome().first[0] == pytest.approx(1 / 3)


def neighbourhood(**heard):
    return Neighbourhood(Setting(episodes=1, episodes_seed=0, **heard), np.random.default_rng(0))


def views(position, velocity, **heard):
    hood = neighbourhood(**heard)
    return hood.views(position, velocity, np.zeros_like(position))


def test_robots_hear_of_their_nearest_neighbours_only():
    seen = views(line(0.0, 1.0, 3.0, 7.0), np.zeros((1, 4, 2)), neighbours=2)
    assert seen.mate_id.tolist() == [[1, 2], [0, 2], [1, 0], [2, 1]]
    assert seen.mates.position_m[0, :, 0].tolist() == [1.0, 3.0]


def test_a_lost_message_leaves_what_was_heard_last():
    hood = neighbourhood(loss=1.0)
    still = np.zeros((1, 2, 2))
    hood.views(line(0.0, 1.0), still, still)
    later = hood.views(line(5.0, 6.0), still, still)
    assert later.own.position_m[:, 0].tolist() == [5.0, 6.0]
    assert later.mates.position_m[:, 0, 0].tolist() == [1.0, 0.0]


def unprojected(*objectives):
    return make_guide(ObjectiveSet(objectives, GuidanceSettings(mode="none", scale=1.0)), DYNAMICS)


def scene(count=200, seed=0):
    """Random actions of one robot amid three, their guide and what it sees."""
    draw = np.random.default_rng(seed)
    guide = unprojected(SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25))
    seen = views(draw.uniform(-0.4, 0.4, (count, 4, 2)), draw.uniform(-0.3, 0.3, (count, 4, 2)))
    outlooks = [look_ahead_batch(seen, preview) for preview in guide.previews]
    return draw.uniform(-1, 1, (4 * count, 2)), guide, outlooks


def costs(action, guide, outlooks):
    total = np.zeros(len(action))
    for objective, outlook in zip(guide.objectives, outlooks, strict=True):
        total += evaluate_batch(objective, outlook.at(action)[0], outlook).cost
    return total


def test_projected_descent_lowers_the_costs_and_stays_near_the_policys_action():
    action, guide, outlooks = scene()
    settings = Descent(radius=0.4, rate=0.1)
    moved = descend(settings, action, guide, outlooks)
    assert (np.linalg.norm(moved - action, axis=1) <= settings.radius + 1e-9).all()
    before, after = costs(action, guide, outlooks), costs(moved, guide, outlooks)
    assert (after <= before + 1e-9).mean() > 0.99
    assert np.array_equal(moved[before == 0.0], action[before == 0.0])


def test_a_shield_reaches_the_safe_set_of_one_objective_at_the_nearest_action():
    guide = unprojected(SpeedLimit(limit_m_s=0.3, buffer_m_s=0.0))
    seen = views(np.zeros((1, 1, 2)), np.array([[[0.5, 0.0]]]))
    outlooks = [look_ahead_batch(seen, preview) for preview in guide.previews]
    action = np.array([[1.0, 0.0]])
    moved = shield(Shield(rounds=3), action, guide, outlooks)
    gain, drift = guide.previews[0].velocity_gain, outlooks[0].drift.velocity_m_s[0, 0]
    assert drift + gain * moved[0, 0] == pytest.approx(0.3)
    assert np.abs(action_slopes(guide, outlooks, moved)[1]).max() < 1e-6


def test_a_shield_leaves_safe_actions_alone():
    action, guide, outlooks = scene()
    moved = shield(Shield(rounds=20), action, guide, outlooks)
    safe = costs(action, guide, outlooks) == 0.0
    assert safe.any()
    assert np.array_equal(moved[safe], action[safe])


def test_guided_episodes_keep_the_limits_that_unguided_ones_break():
    task, bundle = TASKS["navigation"], packaged_bundle("navigation")
    setting = Setting(episodes=4, episodes_seed=5)
    free, steered = (
        run_episodes(task, decider(task, settings, bundle), setting)
        for settings in (UNGUIDED, Guided(guidance=GuidanceSettings()))
    )
    assert free.first.min() > 0.05
    assert steered.first.max() == 0.0


def test_every_method_may_be_tuned_over_as_many_settings():
    for task, method in product(TASKS, METHODS):
        assert len(set(candidates(method, task))) == 8


def test_settings_are_read_by_people_and_kept_as_they_are():
    assert str(SETTINGS) == "terminal, eta 0.3, noise 0.5, reach 0.5"
    (literal, *_) = candidates("CFPG (eqs. 14, 15)", "navigation")
    assert str(literal) == "hierarchical, eta 0.3, noise 1"  # reach means nothing there
    assert [SETTINGS.algorithm(task) for task in TASKS] == ["mafpo-chain", "mafpo-warm", "mafpo-chain"]
    for task, method in product(TASKS, METHODS):
        for settings in candidates(method, task):
            row = make_row(some_key(settings=settings), run_outcome(0.0), "commit")
            assert msgspec.json.decode(msgspec.json.encode(row), type=Row) == row


def test_every_scale_of_the_sweep_keeps_the_other_settings_and_only_flows_have_one():
    swept = scaled(SETTINGS)
    assert [each.guidance.scale for each in swept] == list(SCALES)
    assert {structs.replace(each, guidance=SETTINGS.guidance) for each in swept} == {SETTINGS}
    with pytest.raises(ValueError, match="has no guidance scale"):
        scaled(candidates("PC-MAPPO", "balance")[0])


def some_question(**changes):
    usual = {
        "task": "navigation", "method": "CFPG", "settings": SETTINGS, "seed": 0, "episodes": 10,
        "episodes_seed": 1,
    }  # fmt: skip
    return Question(**{**usual, **changes})


def some_key(**changes):
    return Key(some_question(**changes), "policy", "definition")


def some_row(success=50.0, **changes):
    return make_row(some_key(**changes), run_outcome(success), "commit")


def run_outcome(success):
    judge = NavigationJudge(NAVIGATION, 2)
    judge.add(World(np.tile(line(0, 1, 2, 3), (2, 1, 1))), transition(succeeded=success > 0, episodes=2))
    return judge.outcome()


def test_rows_come_back_as_written_and_know_their_question(tmp_path):
    path = tmp_path / "paper.json"
    changes = ({}, {"seed": 1}, {"neighbours": 3}, {"loss": 0.2}, {"intentions": False}, {"settings": Mean()})
    rows = [some_row(**change) for change in changes]
    write_result(path, rows)
    assert read_result(path, list[Row]) == rows
    assert path.read_text().count("\n") == len(rows) + 2
    assert [row.key for row in rows] == [some_key(**change) for change in changes]
    assert len({row.key for row in rows}) == len(rows)
    assert rows[0].navigation_success == rows[0].multi_objective_success == 100.0
    assert rows[0].payload_distance is None


def changed(**changes):
    row = msgspec.to_builtins(some_row()) | changes
    return msgspec.json.encode([{name: value for name, value in row.items() if value is not None}])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"{}", "Expected `array`"),
        (b"[{}]", "missing required field"),
        (b"no json", "malformed"),
        (changed(mode="terminal, eta 10"), "unknown field `mode`"),
        (changed(task="chess"), "unknown task 'chess'"),
        (changed(margin_violation=None), "`margin_violation` does not fit navigation"),
        (changed(cluster_rmse=0.1), "`cluster_rmse` does not fit navigation"),
        (changed(settings={"kind": "guided", "guidance": {"scale": -1.0}}), "`scale` must be finite"),
        (changed(settings={"kind": "luck"}), "Invalid value 'luck'"),
    ],
)
def test_a_foreign_file_is_refused_and_not_overwritten(tmp_path, content, reason):
    path = tmp_path / "paper.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=f"holds no results of this benchmark .*{reason}"):
        evaluation.evaluate([some_question()], path, POLICIES, 1)
    assert path.read_bytes() == content


def test_finished_rows_are_not_asked_again(monkeypatch, tmp_path):
    row = some_row()
    monkeypatch.setattr(evaluation, "key", lambda _question, _policies: row.key)
    assert list(evaluation.answer_all([some_question()], tmp_path, 1, [row])) == []


def test_rows_of_other_policies_or_definitions_answer_nothing(tmp_path):
    key = evaluation.key(some_question(), POLICIES)
    copied = tmp_path / "navigation" / "mafpo-chain" / "seed-0" / "bundle"
    shutil.copytree(POLICIES / "navigation" / "mafpo-chain" / "seed-0", copied)
    assert evaluation.key(some_question(), tmp_path) == key
    with (copied / "manifest.json").open("a") as manifest:
        manifest.write("\n")
    assert evaluation.key(some_question(), tmp_path).policy != key.policy
    assert key.definition != evaluation.key(some_question(task="sampling"), POLICIES).definition


def test_the_recorded_rows_answer_every_question_of_the_tables(monkeypatch, tmp_path):
    monkeypatch.setattr(evaluation, "answer", lambda *_: pytest.fail("a row is missing"))
    asked = command.questions(list(TASKS), SEEDS, 1000, command.SWEEP_EPISODES)
    (tmp_path / "paper.json").write_bytes(command.RESULTS.read_bytes())
    rows = evaluation.evaluate(asked, tmp_path / "paper.json", POLICIES, 1)
    assert len(rows) == len(asked) == len(read_result(command.RESULTS, list[Row]))
    page = (command.RESULTS.parent / "paper" / "paper.md").read_text()
    assert success_table([row for row in rows if row.episodes == 1000]) in page


def test_another_policy_in_a_seeds_place_is_one_clear_line(tmp_path):
    wrong = tmp_path / "navigation" / "mafpo-chain" / "seed-3"
    shutil.copytree(POLICIES / "sampling" / "mappo" / "seed-1", wrong)
    with pytest.raises(ConfigError, match="mappo on sampling with seed 1, not mafpo-chain on navigation"):
        find_policy(tmp_path, "navigation", "mafpo-chain", 3)


def test_a_missing_seed_is_one_clear_line(tmp_path):
    with pytest.raises(ConfigError, match=r"no bundle of mafpo-chain on navigation with seed 3; make"):
        evaluation.key(some_question(seed=3), tmp_path)


def test_tuning_that_never_happened_is_named():
    tried = Tried("navigation", "CFPG", SETTINGS, 1.0, 1.0)
    with pytest.raises(ConfigError, match="CFPG was not tuned on navigation"):
        chosen([tried], "navigation", "CFPG")
    assert chosen([structs.replace(tried, chosen=True)], "navigation", "CFPG") == SETTINGS


def test_every_method_was_tuned_over_its_candidates():
    tried = read_tuned()
    for task in TASKS:
        for method in METHODS:
            own = [row.settings for row in tried if (row.task, row.method) == (task, method)]
            assert sorted(own, key=str) == sorted(candidates(method, task), key=str)


def test_pairs_are_equivalent_when_their_difference_is_small_and_certain():
    draw = np.random.default_rng(0)
    differences = draw.normal(0.1, 0.5, 10)
    above = stats.ttest_1samp(differences, -1.0, alternative="greater").pvalue
    below = stats.ttest_1samp(differences, 1.0, alternative="less").pvalue
    assert paired_equivalence(differences, 1.0) == pytest.approx(max(above, below))
    assert paired_equivalence(differences + 2.0, 1.0) > 0.5
    assert (paired_equivalence([0.5] * 3, 1.0), paired_equivalence([1.0] * 3, 1.0)) == (0.0, 1.0)
    assert paired([1.0, 3.0]) == (2.0, 1.0)


def test_statistics_over_seeds():
    ours, theirs = [90.0, 91.0, 92.0, 93.0, 94.0], [80.0, 84.0, 83.0, 82.0, 81.0]
    assert str(summarise(ours)) == "92.0 ± 1.6"
    assert welch(ours, theirs) == stats.ttest_ind(ours, theirs, equal_var=False).pvalue
    assert equivalence(ours, theirs) > 0.5
    assert equivalence(ours, [value + 0.5 for value in ours]) < 0.01
    assert math.isnan(welch(ours, [1.0]))
    assert welch([0.0, 0.0], [0.0, 0.0]) == 1.0


def test_the_success_table_shows_what_was_not_run():
    table = success_table([some_row(seed=seed) for seed in (0, 1)])
    assert "| CFPG | 100.0 ± 0.0 (88.7) | not run | not run |" in table


def test_success_is_told_as_a_share_of_what_the_oracle_knows_of_the_same_episodes():
    rows = [some_row(seed=seed) for seed in (0, 1)]
    same = {"task": "navigation", "definition": "definition", "episodes": 10, "commit": ""}
    same |= {"seed": 0, "policy": "p", "settings": UNGUIDED}
    ended = Ended(**same, episodes_seed=1, failures={"late": (3, 4)})
    other = Ended(**same, episodes_seed=2, failures={"late": tuple(range(10))})
    table = share_table(rows, [ended, other])
    assert "| CFPG | 125.0 ± 0.0 | unknown | unknown |" in table
    assert "| possible, % of all episodes | 80.0 to 100.0 | unknown | unknown |" in table
    assert share_table(rows, [other]) == ""


@pytest.mark.parametrize(("flags", "wrong"), [(["--tasks", "chess"], "'chess'"), (["--jobs", "0"], "'0'")])
def test_wrong_flags_are_refused(flags, wrong):
    with pytest.raises(ConfigError, match=f"{wrong}.*; see python -m benchmarks paper --help"):
        command.main(flags)
