"""Policies of somebody else's, for four bodies: fitted, exported, imported, and driven with a margin kept."""

import itertools
import math
from typing import NamedTuple

import pytest
from foreign_policies import POLICIES
from foreign_teams import CEILING_M, asked, distance_m, imported, robots

from edge_runtime.config.fleet import load_fleet
from edge_runtime.config.objectives import load_objective_set
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import TeamState
from edge_runtime.objectives import (
    BUILT_IN,
    Attraction,
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
from firmware_bridge.simulation.bridge import open_bridge

RATE_HZ, LONGEST_S = 10.0, 40.0


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
            made[name] = imported(name, tmp_path_factory.mktemp(name))
        return made[name]

    return bundle


def fleet_of(bundle, folder):
    """Four robots that exchange places."""
    (folder / "team.toml").write_text(robots(bundle.manifest.motion.dims))
    return load_fleet(folder / "team.toml")


def drive(bundle, folder, objectives=None, seed=0):
    """Drive the team in the built-in simulation until all hold their goals; time is the simulation's."""
    fleet = fleet_of(bundle, folder)
    mission = Mission(0, fleet, bundle, objectives or ObjectiveSet(), RATE_HZ, seed)
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
            if away <= fleet.team.arrival_m:
                break
    headings = tuple(state.heading_rad for state in states)
    return Driven(away <= fleet.team.arrival_m, closest, fastest, highest, headings)


@pytest.mark.parametrize("name", POLICIES)
def test_a_team_reaches_its_goals_and_keeps_the_margin_that_its_policy_never_saw(bundles, tmp_path, name):
    bundle = bundles(name)
    (tmp_path / "asked.toml").write_text(asked(name, tmp_path))
    objectives = load_objective_set(tmp_path / "asked.toml")
    assert bundle.manifest.runtime == "numpy"
    alone = [drive(bundle, tmp_path, seed=seed) for seed in (0, 1)]
    guided = [drive(bundle, tmp_path, objectives, seed) for seed in (0, 1)]
    assert all(run.arrived for run in alone + guided)
    assert min(run.closest_m for run in alone) < distance_m(name)
    assert min(run.closest_m for run in guided) >= distance_m(name)
    if name == "drone":
        assert min(run.highest_m for run in alone) > 1.0
        assert max(run.highest_m for run in guided) <= CEILING_M + 0.02
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
    Attraction: Attraction(object="person"),
}
NOT_IN_SPACE = {Passing}
"""What says nothing of robots that may pass over one another."""


def test_every_objective_is_tried():
    assert set(OBJECTIVES) == set(BUILT_IN)


@pytest.mark.parametrize("kind", BUILT_IN, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("name", POLICIES)
def test_an_objective_steers_each_body_or_is_refused_in_a_line(bundles, tmp_path, name, kind):
    bundle, wanted = bundles(name), ObjectiveSet((OBJECTIVES[kind],))
    fleet = fleet_of(bundle, tmp_path)

    def mission():
        return Mission(0, fleet, bundle, wanted, RATE_HZ)

    if kind in (ObstacleMargin, TrackedMargin, Attraction) or (name == "drone" and kind in NOT_IN_SPACE):
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
