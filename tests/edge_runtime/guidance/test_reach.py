"""How far preferences move actions before and after what is carried has come to its goal."""

import numpy as np
import pytest
from guidance_cases import WISHES, guide_for, random_team
from msgspec.structs import replace
from networks import random_weights

from edge_runtime.config.fleet import FLEETS
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.reach import reach_now
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.messages import TrackedObject
from edge_runtime.run.edge_run import main as edge_run

WAITING = GuidanceSettings(reach=0.3, goal_reach=2.0, goal_within_m=0.1)


def load(x, goal=(0.0, 0.0), name="load"):
    return TrackedObject(name, 0.0, (x, 0.0), (0.0, 0.0), goal_m=goal)


@pytest.mark.parametrize(
    ("tracked", "reach"),
    [
        ([], 0.3),
        ([load(0.0, None)], 0.3),
        ([load(0.1)], 2.0),
        ([load(-0.1)], 2.0),
        ([load(0.1001)], 0.3),
        ([load(0.05), load(5.0, None, "person")], 2.0),
        ([load(0.05), load(0.2, name="other")], 0.3),
        ([load(0.05, (0.0, 0.0, 1.0))], 2.0),
        ([replace(load(0.05), position_m=(0.0, 0.05, 1.8))], 2.0),
    ],
)
def test_preferences_wait_until_all_that_has_a_goal_is_there(tracked, reach):
    assert reach_now(WAITING, tracked) == reach
    assert reach_now(replace(WAITING, goal_reach=None), tracked) == 0.3


def test_at_the_goal_preferences_move_actions_as_a_greater_reach_does(make_backend):
    draw, policy = np.random.default_rng(4), make_backend(random_weights(), 4)
    further = 0
    for _ in range(20):
        team, observation = random_team(draw), draw.standard_normal((1, 18)).astype(np.float32)
        for x, reach in ((0.5, 0.3), (0.05, 2.0)):
            found, expected = (
                guided_action(policy, observation, replace(team, tracked=(load(x),)), guide)
                for guide in (
                    guide_for(WISHES, reach=0.3, goal_reach=2.0),
                    guide_for(WISHES, reach=reach),
                )
            )
            assert found.action == expected.action
            further += np.linalg.norm(found.correction) > 0.3 + 1e-6
    assert further > 0


def test_a_team_that_carries_nothing_to_a_goal_is_refused_in_one_line(tmp_path, capsys):
    path = tmp_path / "team.toml"
    path.write_text((FLEETS / "navigation.toml").read_text() + "goal_reach = 2.0\n")
    assert edge_run(["--robot-id", "0", "--fleet", str(path), "--no-log"]) == 2
    assert f"{path}: tracked: none has a `goal_m`, which `goal_reach` waits for" in capsys.readouterr().err
