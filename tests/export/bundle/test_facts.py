"""The facts file: the template is valid, and every mistake in it is named."""

import pytest

from edge_runtime.errors import EdgeError
from export.bundle.facts import FACTS_TEMPLATE, read_facts
from export.scenarios.navigation import FACTS


def write(tmp_path, text):
    path = tmp_path / "facts.toml"
    path.write_text(text)
    return path


def test_template_describes_navigation(tmp_path):
    facts = read_facts(write(tmp_path, FACTS_TEMPLATE))
    assert facts.observation == FACTS.observation
    assert facts.action == FACTS.action
    assert (facts.dynamics, facts.body) == (FACTS.dynamics, FACTS.body)
    assert (facts.observation_dim, facts.control_rate_hz, facts.euler_steps) == (18, 10.0, 10)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('"velocity"', '"speed"', "observation[1].name is 'speed', must be one of position, velocity"),
        ("low = -1.0", "low = 1.0", "action[0].low is 1.0, must be below its high, 1.0"),
        ("low = -1.0", "low = -inf", "action.low: must be a finite number, got -inf"),
        ("low = -1.0", "low = -1e7", "action[0].low is -10000000.0, must be between -1e+06 and 1e+06"),
        ("control_rate_hz = 10.0", "control_rate_hz = nan", "control_rate_hz: must be a finite number"),
        ("control_rate_hz = 10.0", "control_rate_hz = '10'", "control_rate_hz: Expected `float`, got `str`"),
        ("lidar_rays = 12", "lidar_rays = 0", "body.lidar_range_m is 0.35, must be 0 without rays"),
        ("euler_steps = 10", "", "euler_steps: missing; allowed: observation, control_rate_hz"),
        ("euler_steps = 10", "steps = 10", "steps: unknown key; allowed: observation, control_rate_hz"),
        ("[action]", "[action", "is not TOML"),
    ],
)
def test_mistakes(tmp_path, old, new, complaint):
    assert old in FACTS_TEMPLATE
    path = write(tmp_path, FACTS_TEMPLATE.replace(old, new))
    with pytest.raises(EdgeError) as caught:
        read_facts(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(EdgeError, match=r"facts\.toml: cannot be read \(No such file or directory\)"):
        read_facts(tmp_path / "facts.toml")
