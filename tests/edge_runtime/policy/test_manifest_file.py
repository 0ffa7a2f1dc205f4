"""Manifests of format 1: what they said by names is said by sources, and refused by their own keys."""

import json

import pytest
from bundle_files import MANIFEST, write_bundle
from bundle_files import sign as signed
from paths import ROOT

from edge_runtime.errors import BundleError
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import Sensor
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.manifest import BUNDLE_FORMAT

EARLIER = [
    directory
    for directory in sorted((ROOT / "benchmarks" / "policies").glob("*/*/seed-0"))
    if b"cfpg-bundle/1" in (directory / "manifest.json").read_bytes()
]


def first_table(directory):
    """The manifest of a bundle as format 1 wrote it."""
    table = json.loads((directory / "manifest.json").read_bytes())
    motion = {key: table["motion"][key] for key in ("mass_kg", "drag", "dt_s", "substeps")}
    fields = [{key: field[key] for key in ("name", "size", "unit")} for field in table["observation"]]
    rest = {name: value for name, value in table.items() if name != "motion"}
    return rest | {"format": "cfpg-bundle/1", "dynamics": motion, "observation": fields}


@pytest.fixture
def earlier(tmp_path):
    """Write a bundle of format 1, with changes to its table."""

    def write(**changes):
        directory = write_bundle(tmp_path / "tiny")
        signed(directory, json.dumps(first_table(directory) | changes).encode())
        return directory

    return write


def test_it_means_the_same(earlier):
    loaded = load_bundle(earlier()).manifest
    assert loaded.format == BUNDLE_FORMAT
    assert (loaded.observation, loaded.motion) == (MANIFEST.observation, MANIFEST.motion)


def test_what_only_a_simulation_knew_is_a_sensor_of_that_name(earlier):
    fields = [
        {"name": "position", "size": 2, "unit": "m"},
        {"name": "nearby_samples", "size": 16, "unit": "1"},
    ]
    found = load_bundle(earlier(observation=fields)).manifest.observation
    assert found[1] == Sensor("nearby_samples", 16, "1", sensor="nearby_samples")


MISTAKES = [
    ({"dynamics": {"mass_kg": 1.0, "drag": 0.25}}, "dynamics.dt_s: missing; allowed: mass_kg, drag, dt_s"),
    ({"dynamics": {"mass_kg": 0.0, "drag": 0.25, "dt_s": 0.1}}, "motion.mass_kg is 0.0, must be between"),
    ({"observation": ["position"]}, "observation[0]: Expected `table`, got `str`"),
    ({"observation": [{"name": "position", "size": 2}]}, "observation[0].unit: missing; allowed: name, size"),
    ({"motion": {"type": "unicycle", "dt_s": 0.1}}, "motion: unknown key"),
    ({"speed": 3}, "speed: unknown key; allowed: format"),
]


@pytest.mark.parametrize(("changes", "complaint"), MISTAKES)
def test_mistakes(earlier, changes, complaint):
    with pytest.raises(BundleError) as caught:
        load_bundle(earlier(**changes))
    assert complaint in str(caught.value)


@pytest.mark.parametrize("directory", EARLIER, ids=lambda path: "-".join(path.parts[-3:-1]))
def test_bundles_that_were_written_then_load(directory):
    stated = json.loads((directory / "manifest.json").read_bytes())
    loaded = load_bundle(directory).manifest
    assert stated["format"] == "cfpg-bundle/1"
    assert loaded.motion == PointForce(**stated["dynamics"])
    assert [(field.name, field.size, field.unit) for field in loaded.observation] == [
        (field["name"], field["size"], field["unit"]) for field in stated["observation"]
    ]
