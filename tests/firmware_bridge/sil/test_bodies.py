"""Policies of other bodies than a disc, as teams of real processes: each base takes what it can."""

import json
import subprocess
import sys

import foreign_policies
import pytest
from foreign_teams import imported
from msgspec.structs import replace
from sil_reports import LENIENT, unstarved
from waiting import until

from edge_runtime.errors import BundleError, ConfigError
from firmware_bridge.sil.harness.robots import check_robot
from firmware_bridge.sil.scenario import scenario as scenarios
from firmware_bridge.sil.scenario.scenario import Request, prepare
from firmware_bridge.sil.scenario.vehicle import OMNI_PROFILE, PROFILE


@pytest.fixture(scope="module")
def policies(tmp_path_factory):
    """Where the bundles of a unicycle, and of a body in SE(2), lie."""
    folder = tmp_path_factory.mktemp("policies")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(foreign_policies, "STEPS", 400)  # enough to know where the goal is
        for name in ("roller", "disc"):
            imported(name, folder)
    return folder


@pytest.mark.integration
@pytest.mark.parametrize(("name", "profile"), [("roller", PROFILE), ("disc", OMNI_PROFILE)])
def test_real_processes_of_other_bodies_drive_over_can(policies, tmp_path, name, profile):
    """What is judged does not depend on how busy the machine is: all come nearer to their goals."""
    (tmp_path / "lenient.toml").write_text(LENIENT)
    flags = ("--policy", policies / name, "--robots", "2", "--rate", "10", "--duration", "6")
    files = ("--limits", tmp_path / "lenient.toml", "--json", tmp_path / "run.json")
    command = [sys.executable, "-m", "firmware_bridge.sil.edge_sil", *map(str, (*flags, *files))]

    def driven():
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return unstarved((done, json.loads((tmp_path / "run.json").read_text())))

    done, report = until(driven)
    assert done.returncode == 0, done.stderr
    assert (report["policy"], report["ended"]) == (name, [])
    for robot in report["robots"]:
        assert robot["goal_distance_m"] < 1.0  # of 1.74 at the start
    scenario = prepare(Request(policy=policies / name, robots=2), tmp_path)
    assert {station.vehicle.profile for station in scenario.stations} == {profile}


@pytest.mark.parametrize("bridge", ["mavlink", "ros1"])
def test_what_a_base_cannot_follow_is_refused_once_before_anything_starts(
    policies, tmp_path, monkeypatch, bridge
):
    monkeypatch.setattr(scenarios, "check_ros", lambda *_: None)
    scenario = prepare(Request(policy=policies / "disc", bridge=bridge, robots=2), tmp_path)
    with pytest.raises(ConfigError, match="turns and moves sideways"):
        check_robot(scenario, scenario.stations[0])
    scenario = prepare(Request(policy=policies / "roller", bridge=bridge, robots=2), tmp_path)
    check_robot(scenario, scenario.stations[0])
    assert scenario.stations[0].vehicle.ahead_m == 0.0


def test_vmas_moves_what_forces_push(policies, tmp_path):
    request = Request(policy=policies / "roller", task="sampling")
    with pytest.raises(BundleError, match=r"roller: motion.type is 'unicycle'; plant 'vmas' takes"):
        prepare(request, tmp_path)
    assert prepare(replace(request, policy=None), tmp_path).fleet.simulation.plant == "vmas"
