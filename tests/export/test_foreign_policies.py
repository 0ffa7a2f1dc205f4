"""Policies of somebody else's, for four bodies: fitted, exported, imported, and driven with a margin kept."""

import itertools
import math
from typing import NamedTuple

import pytest
from foreign_policies import POLICIES, exported, fitted

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import TeamState
from edge_runtime.objectives import (
    BUILT_IN,
    Clustering,
    Geofence,
    ObstacleMargin,
    Passing,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
    TrackedMargin,
)
from edge_runtime.policy.bundle import load_bundle
from export.edge_export import main as edge_export
from firmware_bridge.simulation.bridge import open_bridge

RATE_HZ, LONGEST_S = 10.0, 40.0
CORNERS = ((-0.8, -0.5), (0.8, 0.5), (-0.8, 0.5), (0.8, -0.5))
HEIGHTS = (0.5, 0.6, 0.7, 0.55)
CEILING = """
from edge_runtime.objectives import Objective, Slope


class Ceiling(Objective, frozen=True, kw_only=True):
    height_m: float

    def evaluate(self, motion, outlook):
        gain = outlook.preview.position_gain
        cure = max(0.0, motion.z - self.height_m) / gain
        return Slope(0.5 * cure * cure, d_z=cure / gain)
"""


class Driven(NamedTuple):
    arrived: bool
    closest_m: float
    fastest_m_s: float
    highest_m: float
    heading_rad: tuple


@pytest.fixture(scope="module")
def bundles(tmp_path_factory):
    """Fit, export and import a policy once, by the command that users have."""
    made = {}

    def bundle(name):
        if name not in made:
            policy, folder = POLICIES[name], tmp_path_factory.mktemp(name)
            field = fitted(policy)
            inputs = field.layers[0].in_features - 1 - field.layers[-1].out_features
            graph = exported(field, inputs, folder / "velocity.onnx")
            (folder / "facts.toml").write_text(policy.facts)
            flags = ["--from-onnx", graph, "--facts", folder / "facts.toml", "--out", folder / name]
            assert edge_export([*map(str, flags)]) == 0
            made[name] = load_bundle(folder / name)
        return made[name]

    return bundle


def fleet_of(bundle, folder):
    """Four robots that exchange places; each faces where it has to go."""
    space = bundle.manifest.motion.dims == 3
    text = ""
    for robot, ((x, y), z) in enumerate(zip(CORNERS, HEIGHTS, strict=True)):
        start, goal = ([x, y, z], [-x, -y, z]) if space else ([x, y], [-x, -y])
        text += f"[[robots]]\nid = {robot}\nstart_m = {start}\ngoal_m = {goal}\n"
        text += f"start_heading_rad = {math.atan2(-y, -x)}\n"
    (folder / "team.toml").write_text(text)
    return load_fleet(folder / "team.toml")


def drive(bundle, folder, asked=None, seed=0):
    """Drive the team in the built-in simulation until all hold their goals; time is the simulation's."""
    fleet = fleet_of(bundle, folder)
    mission = Mission(0, fleet, bundle, asked or ObjectiveSet(), RATE_HZ, seed)
    controller, ends = mission.controller(0), [robot.goal_m for robot in fleet.robots]
    closest, fastest, highest, away = math.inf, 0.0, -math.inf, math.inf
    with open_bridge(mission) as bridge:
        for _ in range(round(LONGEST_S * RATE_HZ)):
            own = bridge.read()
            team = TeamState(own, bridge.teammates())
            command = controller.decide(team, own.stamp_s)
            assert not command.stop_reason
            bridge.write(command)
            states = sorted((own, *(mate.state for mate in team.teammates)), key=lambda state: state.robot_id)
            places = [state.position_m for state in states]
            closest = min(closest, *itertools.starmap(math.dist, itertools.combinations(places, 2)))
            fastest = max(fastest, *(math.hypot(*state.velocity_m_s) for state in states))
            highest = max(highest, *(place[-1] for place in places))
            away = max(map(math.dist, places, ends))
            if away <= fleet.team.goal_tolerance_m:
                break
    headings = tuple(state.heading_rad for state in states)
    return Driven(away <= fleet.team.goal_tolerance_m, closest, fastest, highest, headings)


def margin(name, folder):
    """What is asked of a team: a distance that its policy does not keep alone; of drones a ceiling, too."""
    distance = 0.34 if name == "roller" else 0.38
    text = (
        f"[[objectives]]\ntype = 'safety_margin'\ndistance_m = {distance}\nbuffer_m = 0.04\nlook_ahead = 2\n"
    )
    if name == "drone":
        (folder / "ceiling.py").write_text(CEILING)
        text += "[[objectives]]\ntype = 'ceiling:Ceiling'\nheight_m = 0.9\n"
    (folder / "asked.toml").write_text(text)
    return load_objective_set(folder / "asked.toml")


@pytest.mark.parametrize("name", POLICIES)
def test_a_team_reaches_its_goals_and_keeps_the_margin_that_its_policy_never_saw(bundles, tmp_path, name):
    bundle, asked = bundles(name), margin(name, tmp_path)
    assert bundle.manifest.runtime == "numpy"
    alone = [drive(bundle, tmp_path, seed=seed) for seed in (0, 1)]
    guided = [drive(bundle, tmp_path, asked, seed) for seed in (0, 1)]
    assert all(run.arrived for run in alone + guided)
    distance = asked.objectives[0].distance_m
    assert min(run.closest_m for run in alone) < distance
    assert min(run.closest_m for run in guided) >= distance
    if name == "drone":
        assert min(run.highest_m for run in alone) > 1.0
        assert max(run.highest_m for run in guided) <= 0.92
    if name == "disc":  # it turns to face along y on its way
        assert all(abs(heading - math.pi / 2) < 0.2 for run in guided for heading in run.heading_rad)


OBJECTIVES = {
    SpeedLimit: SpeedLimit(limit_m_s=0.2),
    SafetyMargin: SafetyMargin(distance_m=3.0),
    SpatialOrder: SpatialOrder(order=(3, 1, 2, 0), gap_m=0.1),
    Spacing: Spacing(distance_m=0.3),
    Geofence: Geofence(centre_m=(-0.8, -0.5), radius_m=0.5),
    Clustering: Clustering(radius_m=0.1),
    Passing: Passing(order=(3, 1, 2, 0)),
    ObstacleMargin: ObstacleMargin(distance_m=0.3),
    TrackedMargin: TrackedMargin(object="person", distance_m=0.3),
}
NOT_IN_SPACE = {Passing}
"""What says nothing of robots that may pass over one another."""


def test_every_objective_is_tried():
    assert set(OBJECTIVES) == set(BUILT_IN)


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("name", POLICIES)
def test_an_objective_steers_each_body_or_is_refused_in_a_line(bundles, tmp_path, name, kind):
    bundle, asked = bundles(name), ObjectiveSet((OBJECTIVES[kind],))
    fleet = fleet_of(bundle, tmp_path)

    def mission():
        return Mission(0, fleet, bundle, asked, RATE_HZ)

    if kind in (ObstacleMargin, TrackedMargin) or (name == "drone" and kind in NOT_IN_SPACE):
        with pytest.raises(ConfigError) as caught:
            mission().controller(0)
        assert "\n" not in str(caught.value)
        assert OBJECTIVES[kind].name in str(caught.value)
        return
    with open_bridge(mission()) as bridge:
        controller, own = mission().controller(0), bridge.read()
        team = TeamState(own, bridge.teammates())
        for _ in range(3):
            observation = controller.observe(team)
            guided = controller.act(observation, team)
            assert not guided.fault
            assert math.isfinite(sum(guided.action))
            command = controller.limit(guided, team, own.stamp_s)
            bridge.write(command)
            own = bridge.read()
            team = TeamState(own, bridge.teammates())
    assert len(guided.costs) == 1
