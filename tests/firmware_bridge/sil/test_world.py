"""The plant behind the firmware: it obeys its limits, and what it reports leads back to where it is."""

import math

import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_runtime.config.tracked import Tracked
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from firmware_bridge.can.feedback import DeadReckoning, PlanarPose
from firmware_bridge.kinematics.base import Base, BaseMotion, motion_for
from firmware_bridge.sil.firmware.planar_world import PlanarWorld
from firmware_bridge.sil.firmware.stops import Stops
from firmware_bridge.sil.firmware.truth import Truth
from firmware_bridge.sil.firmware.world import Standing
from firmware_bridge.sil.scenario.faults import Blackout, Kill, Loss
from firmware_bridge.sil.scenario.layout import places
from firmware_bridge.simulation.plant import Plant, contact_forces
from firmware_bridge.simulation.plants import Motion

AHEAD_M, PERIOD_S = 0.2, 0.01
BASE = Base("differential", sideways="lookahead", lookahead_m=AHEAD_M)
MARGIN = 2 * MANIFEST.body.radius_m


def make(*starts, headings=None):
    looks = headings or [0.0] * len(starts)
    standings = [Standing(start, look, AHEAD_M) for start, look in zip(starts, looks, strict=True)]
    return PlanarWorld([MANIFEST] * len(starts), standings, PERIOD_S)


@settings(deadline=None, max_examples=30)
@given(
    heading=st.floats(-3.0, 3.0),
    wanted=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2)),  # drag leaves 0.35 m/s at full force
)
def test_the_disc_takes_the_velocity_that_the_base_was_told(heading, wanted):
    """`motion_for` is what the bridges send; whatever way the base looks, the disc moves as asked."""
    world = make((0.0, 0.0), headings=[heading])
    for _ in range(300):
        motion = motion_for(wanted, world.state(0).heading_rad, BASE)
        world.step([motion])
    np.testing.assert_allclose(world.velocity_m_s[0], wanted, atol=1e-3)


def test_no_command_accelerates_beyond_the_manifests_limits():
    world = make((0.0, 0.0))
    most = max(field.high for field in MANIFEST.action) * PERIOD_S / MANIFEST.motion.mass_kg
    before = np.zeros(2)
    for step in range(50):
        world.step([BaseMotion(100.0 * (-1) ** (step // 10), 0.0, 30.0)])
        after = world.velocity_m_s[0].copy()
        assert np.abs(after - (1 - MANIFEST.motion.at_period(PERIOD_S).drag) * before).max() <= most * 1.001
        before = after


def test_contacts_are_the_plants():
    """Each step from the world's own state; `Plant` is held to VMAS in the same way in test_plant.py."""
    starts = [(-0.12, 0.0), (0.12, 0.05)]
    world = make(*starts, headings=[0.0, math.pi])
    plant = Plant(MANIFEST.motion.at_period(PERIOD_S), MANIFEST.body.radius_m, starts)
    x, _ = MANIFEST.action
    touched = 0
    for _ in range(60):
        plant.position_m[:], plant.velocity_m_s[:] = world.position_m, world.velocity_m_s
        ahead = np.array([(math.cos(h), math.sin(h)) for h in (world.state(0)[1], world.state(1)[1])])
        lacking = ahead - (1.0 - MANIFEST.motion.at_period(PERIOD_S).drag) * plant.velocity_m_s
        world.step([BaseMotion(1.0), BaseMotion(1.0)])
        plant.step(np.clip(lacking * MANIFEST.motion.mass_kg / PERIOD_S, x.low, x.high))
        touched += bool(contact_forces(plant.position_m, MANIFEST.body.radius_m).any())
        np.testing.assert_allclose(world.position_m, plant.position_m, atol=1e-6)
    assert touched > 20


def test_odometry_leads_back_to_the_truth():
    """The guard's own dead reckoning, fed with what the firmware reports, ends where the plant is."""
    draw = np.random.default_rng(3)
    world = make((0.4, -0.3), headings=[1.0])
    axle = world.state(0)
    reckoned = DeadReckoning(0, PlanarPose(*axle.position_m, axle.heading_rad), BASE)
    motion = BaseMotion()
    for step in range(1000):
        if step % 50 == 0:
            motion = BaseMotion(draw.uniform(-0.3, 0.3), 0.0, draw.uniform(-1.0, 1.0))
        world.step([motion])
        pose = world.state(0)
        state = reckoned.advance(BaseMotion(pose.forward_m_s, 0.0, pose.yaw_rad_s), step * PERIOD_S)
    assert math.dist(state.position_m, world.position_m[0]) < 0.02
    assert math.dist(state.velocity_m_s, world.velocity_m_s[0]) < 0.01


def test_collisions_count_once_when_they_begin():
    world = make((-0.3, 0.0), (0.3, 0.0), (0.0, 2.0))
    truth = Truth(world, [(0.0, 0.0)] * 3, (), PERIOD_S)
    for push in (0.5, -0.5, 0.5):
        for _ in range(150):
            world.step([BaseMotion(push), BaseMotion(-push), BaseMotion()])
            truth.follow()
    outcomes = truth.outcomes()
    assert [one.collisions for one in outcomes] == [2, 2, 0]
    assert outcomes[0].least_distance_m <= MARGIN < outcomes[2].least_distance_m
    assert outcomes[2].goal_distance_m == pytest.approx(2.0)


def test_objectives_are_judged_by_the_truth():
    asked = (SpeedLimit(limit_m_s=0.2), SafetyMargin(distance_m=0.25))
    world = make((0.0, 0.0), (0.0, 1.0))
    truth = Truth(world, [(0.0, 0.0)] * 2, asked, PERIOD_S)
    world.velocity_m_s[0] = 0.0, 0.3
    truth.follow()
    world.velocity_m_s[:] = 0.0
    truth.follow()
    world.position_m[1] = 0.0, 0.24
    truth.follow()
    assert [one.violated_s for one in truth.outcomes()] == pytest.approx([2 * PERIOD_S, PERIOD_S])
    assert truth.outcomes()[0].greatest_speed_m_s == pytest.approx(0.3)


def test_a_load_was_at_its_goal_though_it_was_carried_on():
    world = make((0.0, 0.0))
    carried = Tracked("package", goal_m=(1.0, 0.0))
    truth = Truth(world, [None], (), PERIOD_S, [Tracked("door"), carried])
    for x in (0.5, 0.98, 1.3):
        world.objects = lambda x=x: [Motion((9.0, 9.0), (0.0, 0.0)), Motion((x, 0.0), (0.0, 0.0))]
        truth.follow()
    (package,) = truth.objects()
    assert package.name == "package"
    assert package.least_goal_distance_m == pytest.approx(0.02)
    assert package.goal_distance_m == pytest.approx(0.3)


def test_every_fault_has_its_way_to_rest():
    """Robot 7 is told to stop half a second after its guard died; robot 3 never is."""
    faults = (
        Kill(at_s=1.0, robot=7, part="guard"),
        Loss(at_s=0.0, for_s=9.0, share=0.5),
        Kill(at_s=1.0, robot=3),
    )
    world = make((0.0, 0.0), (0.0, 5.0))
    stops = Stops(world, (7, 3), (*faults, Blackout(at_s=8.0, for_s=1.0)), PERIOD_S)
    at_m = {}
    for step in range(400):
        time_s = step * PERIOD_S
        world.step([BaseMotion(0.2 * (time_s < 1.5)), BaseMotion(0.2)])
        stops.follow(time_s)
        at_m[step] = float(world.position_m[0, 0])
    (guard,), nobody, (runtime,), dark = stops.stops()
    assert (guard.robot_id, runtime.robot_id, nobody) == (7, 3, ())
    assert 0.5 < guard.seconds < 1.0 and runtime.seconds is None
    assert guard.metres == pytest.approx(at_m[399] - at_m[99], abs=1e-3)
    assert [(one.robot_id, one.seconds, one.metres) for one in dark] == [(7, None, 0.0), (3, None, 0.0)]


@pytest.mark.parametrize("robots", [1, 2, 3, 4, 8, 12, 16, 32, 64])
def test_generated_teams_are_feasible(robots):
    """Starts and goals keep the margin, and so do robots that all drive straight at the same pace."""
    team = places(robots)
    start, goal = (np.array(column) for column in zip(*team, strict=True))
    assert len(team) == robots
    for share in np.linspace(0.0, 1.0, 21):
        at = start + share * (goal - start)
        distance = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
        np.fill_diagonal(distance, np.inf)
        assert distance.min() > 0.25
    assert np.hypot(*(goal - start).T).min() > 0.3
