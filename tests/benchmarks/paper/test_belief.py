"""A belief of what is left to gather: any method may be given it, and it changes nothing else."""

from dataclasses import replace

import pytest
from msgspec import structs

from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.methods import decider
from benchmarks.paper.settings import Descent, Guided, Shield
from benchmarks.paper.tasks import TASKS
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.policy.bundle import packaged_bundle
from export.episodes.neighbourhood import Setting

BRIEF = replace(TASKS["sampling"], steps=30)


@pytest.mark.parametrize("settings", [Guided(guidance=GuidanceSettings()), Descent(), Shield()], ids=str)
def test_any_method_is_drawn_by_it(settings):
    plain, drawn = (
        run_episodes(
            BRIEF, decider(BRIEF, each, packaged_bundle("sampling")), Setting(episodes=2, episodes_seed=5)
        )
        for each in (settings, structs.replace(settings, belief=True))
    )
    assert (plain.nominal != drawn.nominal).any()


def test_where_a_task_has_none_nothing_changes():
    task, setting = replace(TASKS["navigation"], steps=5), Setting(episodes=2, episodes_seed=5)
    plain, same = (
        run_episodes(task, decider(task, Shield(belief=belief), packaged_bundle("navigation")), setting)
        for belief in (False, True)
    )
    assert (plain.second == same.second).all()
