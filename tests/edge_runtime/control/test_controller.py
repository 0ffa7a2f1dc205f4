"""One robot's stages together: the same seed gives the same commands."""

from pathlib import Path

from bundles import MANIFEST
from networks import random_weights

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.policy.bundle import Bundle

TEAM = TeamState(RobotState(0, 1.0, (0.0, 0.0), (0.0, 0.0)))


def first_actions(seed, start_noise, robot_id=0):
    asked = ObjectiveSet((), GuidanceSettings(start_noise=start_noise))
    bundle = Bundle(MANIFEST, random_weights(), Path())
    mission = Mission(0, load_fleet(DEFAULT_FLEET), bundle, asked, 10.0, seed)
    controller = mission.controller(robot_id)
    return [controller.decide(TEAM, 1.0).action for _ in range(3)]


def test_a_seed_makes_a_noisy_start_reproducible():
    assert first_actions(1, 0.5) == first_actions(1, 0.5)
    assert len(set(first_actions(1, 0.5))) == 3
    assert first_actions(1, 0.5) != first_actions(2, 0.5)


def test_without_noise_the_same_state_gives_the_same_action():
    assert len(set(first_actions(1, 0.0))) == 1
    assert first_actions(1, 0.0) == first_actions(2, 0.0)


def test_robots_draw_their_own_noise():
    """Both robots stand at the same place; only goals and noise tell them apart."""
    assert first_actions(1, 0.5, robot_id=0) != first_actions(0, 0.5, robot_id=0)
    assert first_actions(1, 0.5, robot_id=1) != first_actions(1, 0.5, robot_id=2)


def test_the_newest_command_is_kept():
    bundle = Bundle(MANIFEST, random_weights(), Path())
    fleet = load_fleet(DEFAULT_FLEET)
    controller = Mission(0, fleet, bundle, fleet.objective_set, 10.0).controller(0)
    command = controller.decide(TEAM, 1.0)
    assert controller.command is command
    assert controller.decide(TEAM, 1.0).sequence == command.sequence + 1


def test_a_rehearsal_leaves_no_trace():
    asked = ObjectiveSet((), GuidanceSettings(start_noise=0.5))
    bundle = Bundle(MANIFEST, random_weights(), Path())

    def actions(rehearsals):
        controller = Mission(0, load_fleet(DEFAULT_FLEET), bundle, asked, 10.0).controller(0)
        for _ in range(rehearsals):
            controller.rehearse()
        return [controller.decide(TEAM, 1.0).action for _ in range(2)]

    assert actions(0) == actions(3)
