"""What a team agrees on includes own objectives' code; what comes over the network loads none."""

import sys
from pathlib import Path

import pytest
from bundles import MANIFEST, straight_weights
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, Steering, load_fleet, load_steering
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.plan import digest_of
from edge_runtime.policy.bundle import Bundle

OWN = """
from edge_runtime.objectives import Objective, Slope


class KeepLeft(Objective, frozen=True, kw_only=True, tag="keep_left"):
    border_m: float

    def evaluate(self, motion, outlook):
        return Slope(0.0)
"""
ASK = '[[objectives]]\ntype = "{}:KeepLeft"\nborder_m = 0.5\n'


@pytest.fixture
def steering_of(tmp_path, monkeypatch):
    """Loads the same objectives file on a robot with this code."""

    def load(robot, code, module="own_rules"):
        folder = tmp_path / robot
        folder.mkdir()
        (folder / f"{module}.py").write_text(code)
        (folder / "mine.toml").write_text(ASK.format(module))
        monkeypatch.delitem(sys.modules, module, raising=False)
        return load_steering(folder / "mine.toml")

    yield load
    sys.modules.pop("own_rules", None)


def mission(steering, path=DEFAULT_FLEET):
    fleet = replace(load_fleet(DEFAULT_FLEET), path=path)
    return Mission(0, fleet, Bundle(MANIFEST, straight_weights(), Path()), steering, 10.0)


def test_robots_with_different_code_disagree(steering_of):
    first = digest_of(steering_of("a", OWN))
    assert digest_of(steering_of("b", OWN)) == first
    assert digest_of(steering_of("c", OWN.replace("0.0", "1.0"))) != first


def test_a_digest_is_of_the_code_that_was_loaded(steering_of, tmp_path):
    steering = steering_of("a", OWN)
    before = digest_of(steering)
    (tmp_path / "a" / "own_rules.py").write_text("edited = True")
    assert digest_of(steering) == before


def test_an_order_may_name_what_the_robot_started_with(steering_of):
    steering = steering_of("a", OWN)
    plan = mission(steering).plan_of("new.toml", ASK.format("own_rules").encode())
    assert plan.steering.objectives == steering.objectives
    assert plan.digest == digest_of(steering)


@pytest.mark.parametrize("module", ["rules_beside_the_fleet", "this"])
def test_an_order_loads_no_code(tmp_path, module):
    """Neither what lies beside the fleet file nor what Python brings along (``this`` prints a poem)."""
    (tmp_path / "rules_beside_the_fleet.py").write_text(OWN)
    robot = mission(Steering(), tmp_path / "fleet.toml")
    with pytest.raises(ConfigError) as refusal:
        robot.plan_of("new.toml", ASK.format(module).encode())
    assert f"'{module}:KeepLeft' was not named by the files that the robot started with" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert module not in sys.modules
