"""The ablation: every variant runs, and changes what its name says and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from benchmarks.common.flags import POLICIES
from benchmarks.paper import evaluation
from benchmarks.paper.ablation import ablation_command as ablation
from benchmarks.paper.ablation.ablation_page import ablation_table
from benchmarks.paper.ablation.variants import variants
from benchmarks.paper.candidates import candidates
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import combine_teams, decider, guide_for
from benchmarks.paper.policies import find_policy
from benchmarks.paper.rows import Row
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle, packaged_bundle
from export.episodes.neighbourhood import Neighbourhood, Setting
from export.evaluation.projection import hierarchical_batch

USUAL = {task: candidates("CFPG", task)[-2] for task in TASKS}
DESCENT = {task: candidates("MAPPO+PGD", task)[0] for task in TASKS}
SHIELD = {task: candidates("MAPPO+SHLD", task)[0] for task in TASKS}


def by_name(task, tuned=None):
    asked = variants(TASKS[task], tuned or USUAL[task], DESCENT[task], SHIELD[task])
    return {variant.name: variant for variant in asked}


CASES = [(task, variant) for task in TASKS for variant in by_name(task).values()]


@pytest.mark.parametrize(("task", "variant"), CASES, ids=[f"{task}: {v.name}" for task, v in CASES])
def test_every_variant_runs(task, variant):
    setting = Setting(episodes=2, episodes_seed=5, **variant.circumstances)
    brief = replace(TASKS[task], steps=8)
    bundle = load_bundle(find_policy(POLICIES, task, variant.settings.algorithm(task), 0))
    outcome = run_episodes(brief, decider(brief, variant.settings, bundle), setting)
    assert np.isfinite(outcome.nominal).all()


def test_what_actions_are_worth_is_judged_for_the_policy_that_it_was_fitted_to():
    asked = by_name("balance")["value 0.1"].settings
    with pytest.raises(ConfigError, match="judges another policy"):
        decider(TASKS["balance"], asked, packaged_bundle("balance"))


@pytest.mark.parametrize("task", TASKS)
def test_every_variant_has_a_reason_and_a_row_of_its_own(task):
    asked = list(variants(TASKS[task], USUAL[task], DESCENT[task], SHIELD[task]))
    assert asked[0].name == "reference"
    assert all(variant.reason.endswith(".") for variant in asked)
    assert len({ablation.question(task, variant, 1, 2) for variant in asked}) == len(asked)
    assert len({variant.name for variant in asked}) == len(asked)


def test_only_variants_that_mean_something_are_asked():
    navigation, balance, sampling = (by_name(task) for task in ("navigation", "balance", "sampling"))
    assert "deconfliction off" in balance
    assert "deconfliction off" not in navigation
    assert "reach unlimited" not in navigation  # it has no preferences
    assert "neighbours 2" in navigation
    assert "neighbours 2" not in sampling  # that is everybody
    assert "look-ahead own" not in balance
    near = by_name("balance", structs.replace(USUAL["balance"], look_ahead=1))
    assert "look-ahead own" in near
    assert "look-ahead 1" not in near
    assert {"ease 0 cm", "ease 15 cm", "MAPPO+SHLD, ease"} < navigation.keys()
    assert "ease 10 cm" not in navigation  # that is the reference
    assert "belief off" in sampling
    assert "formation as asked underway" in balance


def objectives(task, settings):
    return guide_for(TASKS[task], settings, packaged_bundle(task)).objectives


def test_a_baseline_gets_the_deconfliction_and_keeps_its_settings():
    helped = by_name("balance")["MAPPO+PGD, deconfliction on"].settings
    assert structs.replace(helped, deconfliction=False) == DESCENT["balance"]


def test_a_reference_that_tuning_made_look_otherwise_keeps_its_look_ahead():
    asked = by_name("balance", structs.replace(USUAL["balance"], look_ahead=1))
    own = (*TASKS["balance"].objectives, *TASKS["balance"].deconfliction)
    near = tuple(structs.replace(objective, look_ahead=1) for objective in own)
    far = tuple(structs.replace(objective, look_ahead=2 * objective.look_ahead) for objective in own)
    for name, expected in (
        ("reference", near), ("loss 20%", near), ("deconfliction off", near[:2]), ("look-ahead own", own),
        ("look-ahead doubled", far),
    ):  # fmt: skip
        assert objectives("balance", asked[name].settings) == expected


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


def test_priorities_can_be_levelled_either_way():
    found = {
        name: guide_for(TASKS["balance"], by_name("balance")[name].settings, packaged_bundle("balance"))
        for name in ("reference", "all required", "all preferred")
    }
    places = {name: (guide.preferences, guide.requirements) for name, guide in found.items()}
    assert places == {
        "reference": ((0, 1), (2,)), "all required": ((), (0, 1, 2)), "all preferred": ((0, 1, 2), ()),
    }  # fmt: skip
    for guide in found.values():  # so the kernel takes them, too
        told = tuple(m for m, term in enumerate(guide.steering.terms) if term.preference)
        assert told == guide.preferences


def test_unknown_intentions_are_zero():
    where = np.random.default_rng(0).uniform(-0.4, 0.4, (3, 3, 4, 2))
    told, untold = (
        Neighbourhood(Setting(episodes=3, episodes_seed=0, intentions=told), None).views(*where)
        for told in (True, False)
    )
    assert told.mate_action.any()
    assert not untold.mate_action.any()
    assert np.array_equal(told.mates.velocity_m_s, untold.mates.velocity_m_s)


def row(seed, success):
    return Row(
        task="navigation", method="CFPG", settings=USUAL, seed=seed, episodes=100, episodes_seed=2,
        multi_objective_success=success, navigation_success=90.0, speeding_violation=1.0,
        margin_violation=2.0, policy="p", definition="d", commit="c",
    )  # fmt: skip


def test_the_table_states_differences_and_reasons():
    reference, other, *_ = by_name("navigation").values()
    answered = [(reference, [row(1, 90.0), row(2, 90.0)]), (other, [row(1, 80.0), row(2, 90.0)])]
    lines = ablation_table("navigation", answered).splitlines()
    assert lines[2].startswith("| reference | 90.0 ± 0.0 |  | 90.0 | 1.0 | 2.0 | The tuned default")
    assert "| 85.0 ± 7.1 | -5.0 ± 6.6 |" in lines[3]


def test_the_command_writes_rows_and_a_page_and_asks_nothing_twice(monkeypatch, tmp_path):
    asked, answer_all = [], evaluation.answer_all

    def counted(questions, policies, _jobs, known):
        for found in answer_all(questions, policies, 1, known):
            asked.append(found)
            yield found

    few = [by_name("navigation")[name] for name in ("reference", "intentions unknown", "loss 20%")]
    monkeypatch.setattr(ablation, "tuned_variants", lambda _task: few)
    monkeypatch.setattr(evaluation, "answer_all", counted)
    flags = ["--tasks", "navigation", "--episodes", "2", "--seeds", "1"]
    for _ in range(2):
        assert ablation.main([*flags, "--json", str(tmp_path / "rows.json")]) == 0
    assert len(asked) == 3
    assert "| intentions unknown |" in (tmp_path / "paper" / "ablation.md").read_text()


def test_the_recorded_page_is_that_of_the_recorded_rows(monkeypatch, tmp_path):
    monkeypatch.setattr(evaluation, "answer", lambda *_: pytest.fail("a row is missing"))
    (tmp_path / "rows.json").write_bytes(ablation.RESULTS.read_bytes())
    assert ablation.main(["--json", str(tmp_path / "rows.json")]) == 0
    page = ablation.RESULTS.parent / "paper" / "ablation.md"
    assert (tmp_path / "paper" / "ablation.md").read_text() == page.read_text()


def test_an_untuned_task_is_one_clear_line(monkeypatch):
    monkeypatch.setattr(ablation, "read_tuned", list)
    with pytest.raises(ConfigError, match=r"MAPPO\+PGD was not tuned on sampling"):
        ablation.tuned_variants("sampling")
