"""What a team agrees on includes own objectives' code; what comes over the network loads none."""

import sys
from pathlib import Path

import pytest
from bundles import MANIFEST, straight_weights
from guidance_cases import DYNAMICS, guide_for
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import digest_of, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.motion.body import Body
from edge_runtime.objectives import SafetyMargin, Spacing, SpeedLimit
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
def asked_of(tmp_path, monkeypatch):
    """Loads the same objectives file on a robot with this code."""

    def load(robot, code, module="own_rules"):
        folder = tmp_path / robot
        folder.mkdir()
        (folder / f"{module}.py").write_text(code)
        (folder / "mine.toml").write_text(ASK.format(module))
        monkeypatch.delitem(sys.modules, module, raising=False)
        return load_objective_set(folder / "mine.toml")

    yield load
    sys.modules.pop("own_rules", None)


def mission(asked, path=DEFAULT_FLEET):
    fleet = replace(load_fleet(DEFAULT_FLEET), path=path)
    return Mission(0, fleet, Bundle(MANIFEST, straight_weights(), Path()), asked, 10.0)


def test_robots_with_different_code_disagree(asked_of):
    first = digest_of(asked_of("a", OWN))
    assert digest_of(asked_of("b", OWN)) == first
    assert digest_of(asked_of("c", OWN.replace("0.0", "1.0"))) != first


def test_a_digest_is_of_the_code_that_was_loaded(asked_of, tmp_path):
    asked = asked_of("a", OWN)
    before = digest_of(asked)
    (tmp_path / "a" / "own_rules.py").write_text("edited = True")
    assert digest_of(asked) == before


def test_an_order_may_name_what_the_robot_started_with(asked_of):
    asked = asked_of("a", OWN)
    guide = mission(asked).guide_of("new.toml", ASK.format("own_rules").encode())
    assert guide.asked.objectives == asked.objectives
    assert guide.digest == digest_of(asked)


@pytest.mark.parametrize("module", ["rules_beside_the_fleet", "this"])
def test_an_order_loads_no_code(tmp_path, module):
    """Neither what lies beside the fleet file nor what Python brings along (``this`` prints a poem)."""
    (tmp_path / "rules_beside_the_fleet.py").write_text(OWN)
    robot = mission(ObjectiveSet(), tmp_path / "fleet.toml")
    with pytest.raises(ConfigError) as refusal:
        robot.guide_of("new.toml", ASK.format(module).encode())
    assert f"'{module}:KeepLeft' was not named by the files that the robot started with" in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert module not in sys.modules


def test_a_guide_stays_as_it_was_made():
    guide = guide_for(
        [SpeedLimit(limit_m_s=0.1), Spacing(distance_m=0.2), SpeedLimit(limit_m_s=1.0, weight=0.0)]
    )
    with pytest.raises(AttributeError, match="immutable"):
        guide.projection = "none"
    assert (len(guide.asked.objectives), len(guide.objectives)) == (3, 2)
    assert [term.kind for term in guide.steering.terms] == ["speed_limit", "spacing"]
    assert (guide.preferences, guide.requirements, guide.version) == ((1,), (0,), 0)


def test_a_robot_that_is_not_guided_keeps_what_was_asked():
    asked = ObjectiveSet((SpeedLimit(limit_m_s=0.1),))
    alone = make_guide(asked, DYNAMICS, guided=False)
    assert (alone.asked, alone.objectives, alone.corrected) == (asked, (), False)
    assert alone.digest == digest_of(ObjectiveSet()) != make_guide(asked, DYNAMICS).digest


def test_a_flow_that_was_trained_to_start_at_zero_does():
    assert make_guide(ObjectiveSet(), DYNAMICS, "zero").start_noise == 0.0
    assert make_guide(ObjectiveSet(), DYNAMICS, "noise").start_noise == 1.0


def test_teammates_are_eased_while_a_margin_keeps_the_distance():
    margin, limit = SafetyMargin(distance_m=0.3), SpeedLimit(limit_m_s=0.1)
    settings = GuidanceSettings(ease_m=0.1)
    assert make_guide(ObjectiveSet((limit, margin), settings), DYNAMICS).ease_m == 0.1
    unguarded = (limit,), (limit, replace(margin, weight=0.0)), ()
    assert [make_guide(ObjectiveSet(each, settings), DYNAMICS).ease_m for each in unguarded] == [0.0] * 3
    assert make_guide(ObjectiveSet((margin,), settings), DYNAMICS, guided=False).ease_m == 0.0


def test_nothing_is_eased_where_no_margin_keeps_robots_from_touching():
    class Own(SafetyMargin, frozen=True, kw_only=True, tag="own"):
        """May cost something else."""

    settings = GuidanceSettings(ease_m=0.1)
    body = Body(radius_m=0.1, lidar_rays=12, lidar_range_m=0.35)

    def ease_m(margin, **changes):
        asked = ObjectiveSet((margin,), replace(settings, **changes))
        return make_guide(asked, DYNAMICS, sensor=body.sensor()).ease_m

    margin = SafetyMargin(distance_m=0.2)
    assert ease_m(margin) == ease_m(margin, mode="correction") == 0.1
    assert ease_m(SafetyMargin(distance_m=0.19)) == ease_m(Own(distance_m=0.3)) == 0.0
    assert {ease_m(margin, mode=mode) for mode in ("none", "hierarchical", "cone")} == {0.0}
