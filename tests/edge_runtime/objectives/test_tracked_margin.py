"""Keeping clear of a tracked object: as of a teammate at its place, by both backends; named, or refused."""

import numpy as np
import pytest

from edge_runtime.config.fleet import FLEETS
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import guide_for
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.motion.model import preview
from edge_runtime.motion.models import PointAcceleration
from edge_runtime.motion.outlook import look_ahead
from edge_runtime.objectives import SafetyMargin, TrackedMargin
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.run.edge_run import main as edge_run

BUNDLE = packaged_bundle("navigation")
OWN = RobotState(0, 0.0, (0.0, 0.0), (0.2, 0.0))
PERSON = TrackedObject("person", 0.0, (0.35, 0.02), (0.0, 0.0))
DOOR = TrackedObject("door", 0.0, (0.1, 0.1), (0.0, 0.0))


def action(objective, team, backend):
    asked = ObjectiveSet((objective,), GuidanceSettings(start_noise=0.0))
    observation = np.zeros((1, BUNDLE.manifest.observation_dim), np.float32)
    return guided_action(BUNDLE.field(backend), observation, team, guide_for(BUNDLE.manifest, asked)).action


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_an_object_is_kept_clear_of_as_a_teammate_that_stands_there(backend):
    mate = Teammate(RobotState(1, 0.0, PERSON.position_m, (0.0, 0.0)))
    of_mate = action(SafetyMargin(distance_m=0.4), TeamState(OWN, (mate,)), backend)
    tracked = TeamState(OWN, tracked=(DOOR, PERSON))
    of_object = action(TrackedMargin(object="person", distance_m=0.4), tracked, backend)
    assert of_object == of_mate
    assert of_object != action(TrackedMargin(object="window", distance_m=0.4), tracked, backend)


WALKING = TrackedObject("person", 0.0, (1.0, 2.0, 0.5), (0.5, -1.0, 0.25), 0.1, 0.2)
FLYING = PointAcceleration(dt_s=0.1, dims=3)


def test_an_object_goes_on_as_it_moves():
    own = RobotState(0, 0.0, (0.0, 0.0, 1.0), (0.2, 0.0, 0.0))
    (seen,) = look_ahead(TeamState(own, tracked=(WALKING,)), preview(FLYING, 3), horizon_s=0.3).tracked
    assert seen == pytest.approx(("person", 1.15, 1.7, 0.5, -1.0, 0.575, 0.25, 0.16, 0.2))
    (flat,) = look_ahead(
        TeamState(OWN, tracked=(WALKING,)), preview(BUNDLE.manifest.motion, 3), horizon_s=0.3
    ).tracked
    assert flat == pytest.approx(("person", 1.15, 1.7, 0.5, -1.0, 0.0, 0.0, 0.16, 0.2))
    guide = guide_for(BUNDLE.manifest, ObjectiveSet((TrackedMargin(object="a", distance_m=1.0),)))
    assert guide.horizons_s == pytest.approx((0.3,))


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_marker_on_the_head_is_kept_clear_of_like_one_on_the_floor(backend):
    margin = TrackedMargin(object="person", distance_m=0.4)
    tall = TrackedObject("person", 0.0, (*PERSON.position_m, 1.8), (0.0, 0.0, 0.0))
    low, high = (action(margin, TeamState(OWN, tracked=(each,)), backend) for each in (PERSON, tall))
    assert low == high


def test_an_object_that_nobody_tracks_is_refused_in_one_line(tmp_path, capsys):
    path = tmp_path / "team.toml"
    asked = '[[objectives]]\ntype = "tracked_margin"\nobject = "persn"\ndistance_m = 0.5\n'
    tracked = '[[tracked]]\nname = "person"\nstart_m = [3.0, 0.0]\n'
    path.write_text((FLEETS / "navigation.toml").read_text() + asked + tracked)
    assert edge_run(["--robot-id", "0", "--fleet", str(path), "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{path}: tracked: tracked_margin looks at 'persn'" in line
    assert "allowed: person" in line
