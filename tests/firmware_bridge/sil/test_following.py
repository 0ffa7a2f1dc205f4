"""Firmware of every body that moves in the plane: it follows what it was told, within its limits."""

import math

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_models import EXAMPLES, accelerations, forces, moving, unicycles, velocities
from msgspec.structs import replace

from edge_runtime.motion.models import Unicycle
from edge_runtime.policy.manifest import ActionField
from firmware_bridge.kinematics.base import Base, BaseMotion, motion_for, turning
from firmware_bridge.sil.firmware.following import Wanted, follower
from firmware_bridge.sil.firmware.planar_world import PlanarWorld
from firmware_bridge.sil.firmware.world import Standing
from firmware_bridge.sil.scenario.vehicle import vehicle

PERIOD_S = 0.01
PLANAR = {name: model for name, model in EXAMPLES.items() if model.dims == 2}
planar = moving(forces | accelerations | velocities | unicycles).filter(lambda case: case[0].dims == 2)


def manifest(model, most=1e9):
    """Whose action is limited to ``most`` each way."""
    action = tuple(ActionField(f"u_{place}", "", -most, most) for place in range(model.action_dim))
    return replace(MANIFEST, motion=model, action=action)


def moved(model, state, action):
    """As the model itself has it: velocity and yaw rate, of a unicycle forward speed and yaw rate."""
    after = model.predict(state, action)
    if isinstance(model, Unicycle):
        speed = after.vx * math.cos(after.heading) + after.vy * math.sin(after.heading)
        return speed, after.yaw_rate
    return (*after.velocity_m_s(2), *[after.yaw_rate] * model.turns)


@settings(deadline=None)
@given(planar, st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_one_step_makes_the_motion_what_was_told_where_limits_allow_it(case, wanted):
    model, state, _ = case
    model = model.at_period(PERIOD_S)
    if isinstance(model, Unicycle):
        rolls = math.cos(state.heading_rad), math.sin(state.heading_rad)
        told = (wanted[0] * rolls[0], wanted[0] * rolls[1], wanted[2])
        state = replace(state, velocity_m_s=(0.3 * rolls[0], 0.3 * rolls[1]))
        expected = (wanted[0], wanted[2])
    else:
        told, expected = wanted, wanted[: 2 + model.turns]
    action = follower(manifest(model), PERIOD_S)(state, Wanted(*told))
    assert moved(model, state, action) == pytest.approx(expected, abs=1e-6)


@given(planar, st.floats(0.1, 2.0))
def test_no_action_is_beyond_its_limits(case, most):
    model, state, _ = case
    action = follower(manifest(model, most), PERIOD_S)(state, Wanted(3.0, -40.0, 500.0))
    assert max(map(abs, action)) <= most


@pytest.mark.parametrize("name", ["line", "skewed table"])
def test_a_body_with_fewer_ways_than_directions_comes_as_near_as_it_can(name):
    """No other action leads nearer: the neighbours' distances are greater."""
    model, draw = PLANAR[name], np.random.default_rng(0)
    wanted = (0.3, -0.2, 0.1)
    case = manifest(model)
    rest = PlanarWorld([case], [Standing((0.0, 0.0), 0.0, 0.0)], model.dt_s).plant.state(0, 0, 0.0)
    action = np.array(follower(case, model.dt_s)(rest, Wanted(*wanted)))

    def away(chosen):
        return math.dist(moved(model, rest, chosen.tolist()), wanted[: 2 + model.turns])

    for _ in range(50):
        assert away(action) <= away(action + 1e-3 * draw.standard_normal(len(action))) + 1e-12


@pytest.mark.parametrize("name", PLANAR)
@pytest.mark.parametrize("bridge", ["can", "mavlink", "ros1"])
def test_every_planar_body_drives_as_its_bridge_tells_it(name, bridge):
    """From setpoint to base and back: the disc takes velocity and yaw rate, wherever the base looks."""
    model = PLANAR[name]
    rolls = isinstance(model, Unicycle)
    looking = Base("differential", sideways="lookahead", lookahead_m=0.2)
    driven = vehicle(bridge, model)
    sideways = bridge == "can" or not model.turns or rolls
    if not sideways or name in ("line", "skewed table"):
        pytest.skip("edge-run refuses it on this base, or it cannot go everywhere")
    if model.turns:
        base = turning(looking) if rolls else Base("omnidirectional")
    else:
        base = replace(looking, lookahead_m=driven.ahead_m)
    world = PlanarWorld([manifest(model, 50.0)], [Standing((1.0, 2.0), 0.7, driven.ahead_m)], PERIOD_S)
    for _ in range(400):
        state = world.state(0)
        along = (math.cos(state.heading_rad), math.sin(state.heading_rad))
        velocity = (0.2 * along[0], 0.2 * along[1]) if rolls else (0.1, -0.15)
        world.step([motion_for(velocity, state.heading_rad, base, 0.3 * model.turns)])
    if not rolls:
        np.testing.assert_allclose(world.velocity_m_s[0], (0.1, -0.15), atol=2e-3)
    assert world.speeds_m_s()[0] == pytest.approx(math.hypot(0.1, 0.15) if not rolls else 0.2, abs=2e-3)
    if model.turns:
        assert world.state(0).yaw_rad_s == pytest.approx(0.3, abs=2e-3)


def test_robots_of_different_bodies_share_a_world():
    models = [PLANAR["force"], PLANAR["unicycle"], PLANAR["paper"]]
    standings = [Standing((0.0, float(place)), 0.0, 0.2 * (place == 0)) for place in range(3)]
    world = PlanarWorld([manifest(model, 5.0) for model in models], standings, PERIOD_S)
    for _ in range(200):
        world.step([BaseMotion(0.2), BaseMotion(0.2), BaseMotion(0.1, 0.2, 0.5)])
    states = [world.state(robot) for robot in range(3)]
    assert [state.forward_m_s for state in states] == pytest.approx([0.2, 0.2, 0.1], abs=2e-3)
    assert states[2].lateral_m_s == pytest.approx(0.2, abs=2e-3)
    assert states[2].yaw_rad_s == pytest.approx(0.5, abs=2e-3)
    assert world.position_m[:2, 0] == pytest.approx([0.4, 0.4], abs=0.02)


def test_a_team_that_pushes_together_touches():
    """What has no steps between its periods is pushed, too."""
    model = PLANAR["unicycle"]
    starts = [Standing((0.0, 0.0), 0.0, 0.0), Standing((0.5, 0.0), math.pi, 0.0)]
    world = PlanarWorld([manifest(model, 1.0)] * 2, starts, PERIOD_S)
    for _ in range(300):
        world.step([BaseMotion(0.2)] * 2)
    assert world.distances_m()[0, 1] > 1.8 * MANIFEST.body.radius_m
    assert world.plant.touched == {(0, 1)}
