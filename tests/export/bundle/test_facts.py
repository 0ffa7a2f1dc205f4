"""The facts file: the template is valid, and every mistake in it is named."""

import pytest
from doc_pages import ROOT, blocks

from edge_runtime.errors import EdgeError
from export.bundle.facts import read_facts
from export.bundle.facts_template import facts_template
from export.scenarios.navigation import FACTS


def write(tmp_path, text):
    path = tmp_path / "facts.toml"
    path.write_text(text)
    return path


def test_template_describes_navigation(tmp_path):
    facts = read_facts(write(tmp_path, facts_template()))
    assert facts.observation == FACTS.observation
    assert facts.action == FACTS.action
    assert (facts.motion, facts.body) == (FACTS.motion, FACTS.body)
    assert (facts.observation_dim, facts.control_rate_hz, facts.euler_steps) == (18, 10.0, 10)


FIELDS = [
    ("3", ": Expected `str | table`, got `int`"),
    ('{ name = "v" }', ".source: missing; allowed: 'position'"),
    ('{ source = "constant", values = [] }', ".values: Expected `array` of length >= 1"),
    ('{ source = "tracked_heading", object = "line", symmetry = 0 }', ".symmetry: Expected `int` >= 1"),
    ('{ source = "time_left", horizon_s = 0 }', ".horizon_s: Expected `float` > 0"),
]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (
            '"velocity"',
            '"speed"',
            "observation[1].source: Invalid value 'speed'; allowed: 'position', 'velocity'",
        ),
        (
            '"velocity"',
            '{ source = "velocity", axes = "body" }',
            "observation[1].axes: unknown key; allowed: name",
        ),
        (
            '"velocity"',
            '{ source = "velocity", frame = "own" }',
            "frame: Invalid enum value 'own'; allowed: 'team'",
        ),
        (
            '"velocity"',
            '{ source = "velocity", size = 3 }',
            "observation[1].size is 3, must be 2 for velocity",
        ),
        (
            '"velocity"',
            '{ source = "velocity", unit = "kn" }',
            "observation[1].unit is 'kn', must be 'm/s' for",
        ),
        (
            '"velocity"',
            '{ source = "sensor", sensor = "gas" }',
            "observation[1].size: missing: how many numbers",
        ),
        (
            '"velocity"',
            '{ source = "own", code = "a:B", size = 0 }',
            "observation[1].size is 0, must be between 1",
        ),
        (
            '"velocity"',
            '{ source = "constant", values = [nan] }',
            "observation[1].values[0]: must be a finite number",
        ),
        (
            '"velocity"',
            '{ source = "teammate_offsets" }',
            "observation[1].count: missing; allowed: name, size",
        ),
        ("low = -1.0", "low = 1.0", "action[0].low is 1.0, must be below its high, 1.0"),
        ("low = -1.0", "low = -inf", "action[0].low: must be a finite number, got -inf"),
        ("low = -1.0", "low = -1e7", "action[0].low is -10000000.0, must be between -1e+06 and 1e+06"),
        (
            '"point_force"',
            '"hover"',
            "motion.type: Invalid value 'hover'; allowed: 'point_force', 'point_acc",
        ),
        ("mass_kg", "mass", "motion.mass: unknown key; allowed: mass_kg, drag"),
        ("substeps = 2", "dims = 3", "action: number of components is 2, must be 3 for point_force"),
        ("control_rate_hz = 10.0", "control_rate_hz = nan", "control_rate_hz: must be a finite number"),
        ("control_rate_hz = 10.0", "control_rate_hz = '10'", "control_rate_hz: Expected `float`, got `str`"),
        ("lidar_rays = 12", "lidar_rays = 0", "body.lidar_range_m is 0.35, must be 0 without rays"),
        ("euler_steps = 10", "", "euler_steps: missing; allowed: observation, control_rate_hz"),
        ("euler_steps = 10", "steps = 10", "steps: unknown key; allowed: observation, control_rate_hz"),
        ("[motion]", "[motion", "is not TOML"),
    ],
)
def test_mistakes(tmp_path, old, new, complaint):
    assert old in facts_template()
    path = write(tmp_path, facts_template().replace(old, new))
    with pytest.raises(EdgeError) as caught:
        read_facts(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)


def test_the_pages_example_is_one(tmp_path):
    (example,) = [block for block in blocks(ROOT / "docs" / "policy.md", "toml") if "motion" in block]
    facts = read_facts(write(tmp_path, example))
    assert (facts.observation_dim, facts.motion.action_dim, facts.motion.dims) == (18, 3, 3)


def test_missing_file(tmp_path):
    with pytest.raises(EdgeError, match=r"facts\.toml: cannot be read \(No such file or directory\)"):
        read_facts(tmp_path / "facts.toml")
