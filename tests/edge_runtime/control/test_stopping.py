"""How far a robot travels after each fault: against a robot that is moved step by step."""

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.bridge import Reaction
from edge_runtime.control.mission import Mission
from edge_runtime.control.stopping import NOTICING_S, Travel, describe, stopping, travels
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle

REACTION = Reaction(0.06, 0.5, 2.0)
STEP_S = 1e-3


def mission(*objectives, guided=True, **robot):
    fleet = load_fleet(DEFAULT_FLEET)
    robots = tuple(msgspec.structs.replace(one, **robot) for one in fleet.robots)
    fleet = msgspec.structs.replace(fleet, robots=robots)
    asked = msgspec.structs.replace(fleet.objective_set, objectives=objectives)
    return Mission(0, fleet, packaged_bundle("navigation"), asked, 50.0, guided=guided)


@settings(deadline=None, max_examples=30)
@given(
    speed=st.floats(0.01, 2.0),
    deceleration=st.floats(0.5, 5.0),
    deadline=st.floats(0.02, 0.1),
    alone=st.floats(0.1, 1.0),
)
def test_it_drives_on_until_it_is_told_and_then_brakes(speed, deceleration, deadline, alone):
    found = {one.fault: one for one in travels(speed, deceleration, Reaction(deadline, alone, None))}
    assert list(found) == ["runtime dead", "runtime frozen", "guard dead", "link cut"]
    assert found["runtime frozen"].seconds == pytest.approx(deadline + NOTICING_S)
    assert found["guard dead"].metres == found["link cut"].metres
    for one in found.values():
        way_m, left_m_s, time_s = 0.0, speed, 0.0
        while left_m_s > 0.0:
            way_m += left_m_s * STEP_S
            time_s += STEP_S
            left_m_s -= deceleration * STEP_S * (time_s > one.seconds)
        assert one.metres == pytest.approx(way_m, abs=3.0 * speed * STEP_S)


@pytest.mark.parametrize("timeout_s", [None, 0.0])
def test_without_a_timeout_of_the_firmware_nothing_ends_the_way(timeout_s):
    *_, dead, cut = travels(0.3, 1.0, Reaction(0.06, timeout_s, None))
    assert (dead, cut) == (Travel("guard dead", None, None), Travel("link cut", None, None))


def test_the_speed_is_the_least_of_all_limits():
    asked = (SpeedLimit(limit_m_s=0.3), SpeedLimit(limit_m_s=0.2))
    assert stopping(mission(*asked), 1.5, REACTION).speed_m_s == 0.2
    assert stopping(mission(*asked, guided=False), 1.5, REACTION).speed_m_s == 1.5
    assert stopping(mission(*asked, max_speed_m_s=0.1), 1.5, REACTION).speed_m_s == 0.1
    assert stopping(mission(), 1.5, REACTION).speed_m_s == 1.5


def test_it_brakes_as_its_profile_says_or_as_its_actions_can():
    assert stopping(mission(), 1.0, REACTION).deceleration_m_s2 == 2.0
    own = msgspec.structs.replace(REACTION, deceleration_m_s2=None)
    manifest = packaged_bundle("navigation").manifest
    expected = manifest.action[0].high / manifest.motion.mass_kg
    assert stopping(mission(), 1.0, own).deceleration_m_s2 == pytest.approx(expected)


def test_a_way_longer_than_the_margin_leaves_room_for_is_named():
    """The packaged policy's discs have a radius of 0.1 m: a margin of 0.25 m leaves 5 cm between them."""
    found = stopping(mission(SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)), 1.5, REACTION)
    assert found.room_m == pytest.approx(0.05)
    assert [one.fault for one in found.too_long] == ["guard dead", "link cut"]
    assert describe(found) == (
        "at 0.3 m/s, braking with 2 m/s^2: runtime dead 0.03 m, runtime frozen 0.05 m, guard dead 0.17 m, "
        "link cut 0.17 m; the safety margin leaves 0.05 m between two robots, less than after: guard dead, "
        "link cut"
    )


def test_without_a_margin_nothing_is_too_long():
    endless = msgspec.structs.replace(REACTION, firmware_timeout_s=0.0)
    found = stopping(mission(SpeedLimit(limit_m_s=0.3)), 1.5, endless)
    assert (found.room_m, found.too_long) == (None, ())
    assert describe(found).endswith("guard dead without end, link cut without end")
