"""What holds together and is hardly meant."""

import pytest

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.doubts import doubts
from edge_runtime.control.mission import Mission
from edge_runtime.policy.bundle import packaged_bundle

TEAM = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [{goal}, 0]\n"
LIMIT = "[[objectives]]\ntype = 'speed_limit'\nlimit_m_s = {limit}\n"


def doubted(folder, goal=3.0, limit=0.3, rate_hz=10.0):
    path = folder / "team.toml"
    path.write_text(TEAM.format(goal=goal) + LIMIT.format(limit=limit))
    fleet = load_fleet(path)
    return list(doubts(Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, rate_hz)))


@pytest.mark.parametrize(("numbers", "said"), [
    ({"limit": 200.0}, "the speed limit of 200 m/s asks for nothing: the policy drives 0.4 m/s at most"),
    ({"goal": 1000.0}, "the goal of robot 0 is 1000 m from its start, 2500 s at the 0.4 m/s"),
    ({"rate_hz": 500.0}, "the rate of 500 Hz is far from the 10 Hz that the policy was trained at"),
    ({"rate_hz": 4.0}, "the rate of 4 Hz is far from"),
])  # fmt: skip
def test_what_is_hardly_meant_is_said(tmp_path, numbers, said):
    (found,) = doubted(tmp_path, **numbers)
    assert found.startswith(said)


@pytest.mark.parametrize("numbers", [{}, {"rate_hz": 50.0}, {"limit": 1.0, "goal": 30.0}])
def test_what_can_be_meant_passes(tmp_path, numbers):
    assert doubted(tmp_path, **numbers) == []
