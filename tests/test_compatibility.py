"""What earlier versions left behind is still read: see CHANGELOG.md, "Compatibility"."""

import hashlib
import re
from importlib import metadata

import pytest
from msgspec.structs import replace
from paths import ROOT, SUPPORT

from edge_runtime import __version__
from edge_runtime.config.fleet import load_fleet
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.manifest_file import read_manifest
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import LoggedObjectiveSet
from edge_runtime.tools.replay.edge_replay import main
from edge_runtime.tools.replay.replay import recorded_objectives

FIRST = SUPPORT / "artefacts" / "0.1.0"
LOG = FIRST / "navigation.mcap"


def test_a_log_of_an_earlier_version_replays(capsys):
    """Bit for bit where this processor has the log's instruction set, else within a tolerance."""
    assert main([str(LOG)]) == 0
    assert "98 ticks" in capsys.readouterr().out


def test_requirements_of_logs_that_do_not_say_how_often_corrected_once():
    chosen = next(item for item in read_log(LOG) if isinstance(item, LoggedObjectiveSet))
    assert recorded_objectives(chosen, LOG).guidance.requirement_steps == 1


def test_the_bundle_of_an_earlier_version_loads():
    """Its policy is packaged to this day; one that goes stays among the artefacts, as its manifests do."""
    recorded = next(iter(read_log(LOG))).bundle
    assert packaged_bundle(recorded.name).stands_for(recorded.sha256)
    encoded = (FIRST / "manifest.json").read_bytes()
    assert hashlib.sha256(encoded).hexdigest() == recorded.sha256
    manifest = read_manifest(encoded, FIRST / "manifest.json")
    now = packaged_bundle(recorded.name).manifest
    known = [replace(field, seen=None) for field in now.observation]
    as_it_was = {"sampler": "euler", "sampler_steps": None, "supersedes": ()}
    assert replace(now, observation=tuple(known), **as_it_was) == manifest


def test_a_fleet_file_of_an_earlier_version_means_the_same():
    fleet = load_fleet(FIRST / "team.toml")
    assert [(robot.id, robot.mass_kg, robot.max_speed_m_s) for robot in fleet.robots] == [
        (0, None, None),
        (1, 1.5, 0.4),
    ]
    assert [objective.name for objective in fleet.objective_set.objectives] == [
        "speed_limit",
        "safety_margin",
    ]


def test_the_version_is_said_alike_everywhere():
    (newest, *_) = re.findall(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert __version__ == metadata.version("cfpg-edge") == newest


@pytest.mark.parametrize("field", ["Requires-Python", "License-Expression", "Summary"])
def test_the_package_says_what_an_index_asks_for(field):
    assert metadata.metadata("cfpg-edge")[field]
