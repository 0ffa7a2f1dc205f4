"""The ablation: every variant runs, and changes what its name says and nothing else."""

import json
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np
import pytest
import torch

from benchmarks.paper import evaluation
from benchmarks.paper.ablation import ablation_command as ablation
from benchmarks.paper.ablation.ablation_command import all_variants, question
from benchmarks.paper.ablation.ablation_page import ablation_table, write_ablation
from benchmarks.paper.ablation.circumstances import MASSES_KG
from benchmarks.paper.ablation.joint import combine_teams
from benchmarks.paper.ablation.mixed_team import guided_by_own_mass
from benchmarks.paper.ablation.priorities import all_preferred, all_required
from benchmarks.paper.ablation.samples import action_costs, best_of, cheapest, mates_actions
from benchmarks.paper.ablation.views import rows_of, uninformed
from benchmarks.paper.candidates import candidates
from benchmarks.paper.episodes import Setting, run_episodes
from benchmarks.paper.evaluation import Question
from benchmarks.paper.masses import set_masses
from benchmarks.paper.methods import guided
from benchmarks.paper.neighbourhood import Neighbourhood
from benchmarks.paper.rows import Row
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.policy.bundle import packaged_bundle
from export.evaluation.guidance import action_slopes
from export.evaluation.outlook import look_ahead_batch
from export.evaluation.projection import hierarchical_batch
from export.scenarios import make_scenario

CPU = torch.device("cpu")
NAVIGATION = TASKS["navigation"]


def variants_of(task):
    return all_variants(
        TASKS[task], candidates(TASKS[task], "CFPG")[0], candidates(TASKS[task], "MAPPO+PGD")[0]
    )


CASES = [(task, variant) for task in TASKS for variant in variants_of(task)]


def by_name(task):
    return {variant.name: variant for variant in variants_of(task)}


@pytest.mark.parametrize(("task", "variant"), CASES, ids=[f"{task}: {v.name}" for task, v in CASES])
def test_every_variant_runs(task, variant):
    setting = Setting(2, 5, variant.neighbours, variant.loss, variant.masses_kg)
    brief = replace(TASKS[task], steps=8)
    outcome = run_episodes(brief, variant.who.make(packaged_bundle(task)), setting)
    assert np.isfinite(outcome.nominal).all()


@pytest.mark.parametrize("task", TASKS)
def test_every_variant_has_a_reason_and_a_row_of_its_own(task):
    variants = variants_of(task)
    assert variants[0].name == "reference"
    assert all(variant.reason.endswith(".") for variant in variants)
    rows = {(v.who.method, v.who.mode, v.neighbours, v.loss) for v in variants}
    assert len(rows) == len(variants)


def test_only_variants_that_mean_something_are_asked():
    navigation, balance, sampling = (by_name(task) for task in ("navigation", "balance", "sampling"))
    assert "two heavy, known" in navigation
    assert "two heavy, known" not in balance
    assert "deconfliction off" in balance
    assert "deconfliction off" not in navigation
    assert "reach unlimited" not in navigation  # it has no preferences
    assert "neighbours 2" in navigation
    assert "neighbours 2" not in sampling  # that is everybody


def test_a_baseline_gets_the_deconfliction_and_keeps_its_settings():
    asked = by_name("balance")
    plain, helped = asked["MAPPO+PGD"].who, asked["MAPPO+PGD, deconfliction on"].who
    assert helped.make.args[0] == plain.make.args[0]
    assert helped.make.args[1] == (*TASKS["balance"].objectives, *TASKS["balance"].deconfliction)
    assert helped.algorithm == "mappo"


def test_a_reference_that_tuning_made_look_otherwise_keeps_its_look_ahead():
    task, usual = TASKS["balance"], candidates(TASKS["balance"], "CFPG")[0]
    own = (*task.objectives, *task.deconfliction)
    near = tuple(msgspec.structs.replace(objective, look_ahead=1) for objective in own)
    tuned = replace(usual, make=partial(guided, usual.guidance, near))
    descent = candidates(task, "MAPPO+PGD")[0]
    asked = {variant.name: variant.who.make for variant in all_variants(task, tuned, descent)}
    assert asked["reference"].args[1] == asked["loss 20%"].args[1] == near
    assert asked["deconfliction off"].args[1] == near[:2]
    assert asked["MAPPO+PGD, deconfliction on"].args[1] == asked["look-ahead own"].args[1] == own
    assert "look-ahead 1" not in asked
    assert "look-ahead own" not in by_name("balance")


def random_directions(rows, seed=0):
    draw = np.random.default_rng(seed)
    return draw.normal(size=(3, rows, 2)), np.array([1.0, 2.0, 0.5]), draw.normal(size=(rows, 2))


def test_joint_projection_of_a_team_of_one_is_the_robots_own():
    directions = random_directions(50)
    joint = combine_teams(hierarchical_batch, 1, *directions)
    assert joint == pytest.approx(hierarchical_batch(*directions))


def test_joint_projection_acts_on_the_concatenated_team():
    gradients, factors, nominal = random_directions(6)
    joint = combine_teams(hierarchical_batch, 3, gradients, factors, nominal)
    for team in (slice(0, 3), slice(3, 6)):
        own = gradients[:, team].reshape(3, 1, 6)
        expected = hierarchical_batch(own, factors, nominal[team].reshape(1, 6))
        assert joint[team].reshape(1, 6) == pytest.approx(expected)
    assert not np.allclose(joint, hierarchical_batch(gradients, factors, nominal))


def test_joint_projection_guides_the_whole_team():
    joint = by_name("navigation")["joint hierarchical"].who.make
    gradients, factors, nominal = random_directions(4)
    found = joint.keywords["combine"](gradients, factors, nominal)
    assert found == pytest.approx(combine_teams(hierarchical_batch, 4, gradients, factors, nominal))


def dynamics(task):
    return packaged_bundle(task).manifest.dynamics


def balance_guide():
    task = TASKS["balance"]
    return make_guide(ObjectiveSet((*task.objectives, *task.deconfliction)), dynamics("balance"))


def test_priorities_can_be_levelled_either_way():
    usual = balance_guide()
    assert (usual.preferences, usual.requirements) == ((0, 1), (2,))
    required, preferred = all_required(balance_guide()), all_preferred(balance_guide())
    assert (required.preferences, required.requirements) == ((), (0, 1, 2))
    assert (preferred.preferences, preferred.requirements) == ((0, 1, 2), ())


def test_the_cheapest_sample_is_chosen_by_each_robot_or_by_the_team():
    score = np.array([[1.0, 5.0, 2.0, 2.0], [2.0, 1.0, 1.0, 4.0]])
    assert cheapest(score, 1).tolist() == [0, 1, 1, 0]
    assert cheapest(score, 2).tolist() == [1, 1, 0, 0]


def some_views(episodes=3, robots=4, seed=0):
    draw = np.random.default_rng(seed)
    hood = Neighbourhood(episodes, robots, None, 0.0, draw)
    return hood.views(*draw.uniform(-0.4, 0.4, (3, episodes, robots, 2)))


def test_costs_are_those_whose_slopes_guide():
    guide = make_guide(
        ObjectiveSet(NAVIGATION.objectives, GuidanceSettings(mode="none")), dynamics("navigation")
    )
    views = some_views()
    outlooks = [look_ahead_batch(views, preview) for preview in guide.previews]
    action, step = np.random.default_rng(1).uniform(-1, 1, (12, 2)), 1e-6
    weights = np.array([objective.weight for objective in guide.objectives])
    slope = np.einsum("m,mbd->bd", weights, action_slopes(guide, outlooks, action))
    for axis in np.eye(2):
        ahead, behind = (action_costs(guide, outlooks, action + way * step * axis) for way in (1, -1))
        assert (ahead - behind) / (2 * step) == pytest.approx(slope @ axis, abs=1e-4)


def test_teammates_actions_are_those_of_the_same_team():
    action = np.arange(12.0).reshape(6, 2)
    mates = mates_actions(action, np.array([[1, 2], [0, 2], [0, 1]] * 2), 3)
    assert mates[0].tolist() == action[[1, 2]].tolist()
    assert mates[4].tolist() == action[[3, 5]].tolist()


def decisions(make, views=None, seed=3):
    views = some_views() if views is None else views
    count = len(views.robot_id)
    observation = np.random.default_rng(1).normal(size=(count, 18)).astype(np.float32)
    return make(count)(observation, views, np.random.default_rng(seed))


@pytest.mark.parametrize("team", [None, 4])
def test_the_best_of_one_sample_is_guidance_as_usual(team):
    bundle, settings = packaged_bundle("navigation"), GuidanceSettings()
    usual = decisions(guided(settings, NAVIGATION.objectives, bundle))
    single = decisions(best_of(settings, NAVIGATION.objectives, 1, team, bundle))
    assert single == pytest.approx(np.clip(usual, -1, 1))


def test_unknown_intentions_are_zero():
    bundle, settings = packaged_bundle("navigation"), GuidanceSettings()
    views = some_views()
    silent = replace(views, mate_action=np.zeros_like(views.mate_action))
    make = guided(settings, NAVIGATION.objectives, bundle)
    unknowing = decisions(uninformed(settings, NAVIGATION.objectives, bundle), views)
    assert np.array_equal(unknowing, decisions(make, silent))
    assert not np.array_equal(unknowing, decisions(make, views))


def test_rows_of_views_keep_their_order():
    views = some_views()
    picked = rows_of(views, np.array([5, 0, 5]))
    assert picked.robot_id.tolist() == [1, 0, 1]
    assert np.array_equal(picked.mate_position_m, views.mate_position_m[[5, 0, 5]])


def test_a_heavy_robot_gathers_half_the_speed():
    light, heavy = (make_scenario("navigation", 1, 0, CPU, training=False) for _ in range(2))
    set_masses(heavy, MASSES_KG)
    push = torch.tensor([[[0.5, 0.0]] * 4])
    for world in (light, heavy):
        world.step(push)
    ratio = heavy.motion()[1][0, :, 0] / light.motion()[1][0, :, 0]
    assert ratio.tolist() == pytest.approx([1.0, 1.0, 0.5, 0.5], rel=1e-4)


def test_only_navigation_takes_masses():
    with pytest.raises(
        ValueError, match="only Navigation's robots can be given masses, not those of balance"
    ):
        set_masses(make_scenario("balance", 1, 0, CPU, training=False), MASSES_KG)


def test_guidance_by_own_mass_is_the_usual_where_all_weigh_the_same_and_pushes_heavy_robots_harder():
    bundle, settings = packaged_bundle("navigation"), GuidanceSettings(start_noise=0.0)
    usual = decisions(guided(settings, NAVIGATION.objectives, bundle))
    same = decisions(guided_by_own_mass(settings, NAVIGATION.objectives, (1.0,) * 4, bundle))
    mixed = decisions(guided_by_own_mass(settings, NAVIGATION.objectives, MASSES_KG, bundle))
    heavy = np.tile(np.array(MASSES_KG) > 1.0, 3)
    assert same == pytest.approx(usual, rel=1e-4)
    assert mixed[~heavy] == pytest.approx(usual[~heavy], rel=1e-4)
    assert not np.allclose(mixed[heavy], usual[heavy], atol=1e-2)


def row(seed, success, mode="reference"):
    return Row(
        task="navigation", method="CFPG", mode=mode, seed=seed, episodes=100, episodes_seed=2,
        multi_objective_success=success, navigation_success=90.0, speeding_violation=1.0,
        margin_violation=2.0, policy="p", definitions="d", commit="c",
    )  # fmt: skip


def test_the_table_states_differences_reasons_and_what_is_missing(tmp_path):
    reference, other, missing = variants_of("navigation")[:3]
    answered = [
        (reference, [row(1, 90.0), row(2, 90.0)]),
        (other, [row(1, 80.0), row(2, 90.0)]),
        (missing, []),
    ]
    lines = ablation_table("navigation", answered).splitlines()
    assert lines[2].startswith("| reference | 90.0 ± 0.0 |  | 90.0 | 1.0 | 2.0 | The tuned default")
    assert "| 85.0 ± 7.1 | -5.0 ± 6.6 |" in lines[3]
    assert f"| {missing.name} | not run |" in lines[4]
    page = tmp_path / "paper" / "ablation.md"
    write_ablation({"navigation": answered}, page)
    assert "Policies of seeds 1, 2, 100 episodes each." in page.read_text()


def test_the_command_writes_rows_and_a_page_and_asks_nothing_twice(monkeypatch, tmp_path):
    asked = []

    def found(questions, policies, _jobs, known):
        have = {one.key for one in known}
        for one in questions:
            if evaluation.key(one, policies) not in have:
                asked.append(one)
                yield evaluation.answer(one, policies)

    names = ("reference", "two heavy, known", "loss 20%")
    few = [variant for variant in variants_of("navigation") if variant.name in names]
    monkeypatch.setattr(ablation, "tuned_variants", lambda _task: few)
    monkeypatch.setattr(ablation, "answer_all", found)
    monkeypatch.setattr(evaluation, "load_policy", lambda *_: packaged_bundle("navigation"))
    flags = ["--ablation", "--tasks", "navigation", "--episodes", "2", "--seeds", "1"]
    for _ in range(2):
        assert ablation.main([*flags, "--json", str(tmp_path / "rows.json")]) == 0
    assert len(asked) == len(json.loads((tmp_path / "rows.json").read_bytes())) == 3
    assert "| two heavy, known |" in (tmp_path / "paper" / "ablation.md").read_text()


def test_a_question_carries_a_variants_circumstances():
    asked = by_name("navigation")
    assert question("navigation", asked["neighbours 1"], 1, 2).neighbours == 1
    assert question("navigation", asked["loss 80%"], 1, 2).loss == 0.8
    heavy = question("navigation", asked["two heavy, unknown"], 1, 2)
    assert isinstance(heavy, Question)
    assert heavy.masses_kg == MASSES_KG


def test_an_untuned_task_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(ablation, "read_tuned", list)
    with pytest.raises(ConfigError, match="CFPG was not tuned on sampling"):
        ablation.tuned_variants("sampling")
