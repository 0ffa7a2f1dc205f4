"""A bundle of format 1 becomes one of today's: another manifest, the same policy, or nothing at all."""

import json
import shutil

import numpy as np
import pytest
from paths import ROOT

from edge_runtime.observation import Constant, Sensor
from edge_runtime.policy.bundle import digest_line, load_bundle
from export.bundle.parity import random_inputs
from export.edge_export import main
from export.scenarios import SCENARIOS, scenario_facts

POLICIES = ROOT / "benchmarks" / "policies"


@pytest.fixture
def old(tmp_path):
    def copy(task, algorithm="mafpo-chain"):
        return shutil.copytree(POLICIES / task / algorithm / "seed-0", tmp_path / "old")

    return copy


def upgrade(directory, capsys):
    code = main(["--upgrade", str(directory)])
    told = capsys.readouterr()
    return code, told.out or told.err


@pytest.mark.parametrize("task", SCENARIOS)
def test_fields_get_the_sources_of_their_task(old, capsys, task):
    directory = old(task)
    before, files = load_bundle(directory), {path: path.read_bytes() for path in directory.glob("policy.*")}
    code, told = upgrade(directory, capsys)
    assert (code, told.count("\n")) == (0, 1)
    after = load_bundle(directory)
    assert after.manifest.observation == scenario_facts(task).observation
    assert json.loads((directory / "manifest.json").read_bytes())["format"] == "cfpg-bundle/2"
    assert {path: path.read_bytes() for path in directory.glob("policy.*")} == files
    inputs = random_inputs(after.manifest, 20).arrays()
    np.testing.assert_array_equal(before.policy(20).evaluate(*inputs), after.policy(20).evaluate(*inputs))


def test_a_signature_of_the_old_manifest_goes_and_is_told_of(old, capsys):
    directory = old("navigation")
    (directory / "manifest.sig").write_bytes(b"of the old one")
    code, told = upgrade(directory, capsys)
    assert (code, told.count("\n")) == (0, 1)
    assert "sign it again with --sign" in told
    assert not (directory / "manifest.sig").exists()


def test_a_preference_is_what_validation_preferred(old, capsys):
    directory = old("navigation", "pc-mappo")
    assert upgrade(directory, capsys)[0] == 0
    *_, preference = load_bundle(directory).manifest.observation
    assert preference == Constant("preference", 3, "1", values=(1 / 3,) * 3)


def test_fields_of_nobodys_task_stay_sensors(old, capsys):
    directory = old("sampling")
    manifest = json.loads((directory / "manifest.json").read_bytes()) | {"training": None}
    encoded = json.dumps(manifest).encode()
    (directory / "manifest.json").write_bytes(encoded)
    (directory / "manifest.sha256").write_bytes(digest_line(encoded))
    assert upgrade(directory, capsys)[0] == 0
    *_, samples = load_bundle(directory).manifest.observation
    assert samples == Sensor("nearby_samples", 8, "1", sensor="nearby_samples")


def test_what_is_of_today_already_or_no_bundle_is_refused_and_left(old, capsys, tmp_path):
    directory = old("navigation")
    upgrade(directory, capsys)
    before = {path: path.read_bytes() for path in directory.iterdir()}
    assert upgrade(directory, capsys) == (
        2,
        f"edge-export: {directory}: is of format cfpg-bundle/2 already\n",
    )
    assert {path: path.read_bytes() for path in directory.iterdir()} == before
    code, told = upgrade(tmp_path / "nowhere", capsys)
    assert (code, told.count("\n")) == (2, 1)
    assert "no such bundle directory" in told
