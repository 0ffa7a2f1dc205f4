"""What a policy's robot cannot be asked is said before anything is opened, in one line."""

from dataclasses import replace

import msgspec
import pytest

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.objectives import Geofence
from edge_runtime.policy.bundle import packaged_bundle

FENCE = Geofence(centre_m=(0.0, 0.0, 1.0), radius_m=0.1)


def mission(bundle, guided=True):
    fleet = load_fleet(DEFAULT_FLEET)
    asked = msgspec.structs.replace(fleet.objective_set, objectives=(FENCE,))
    return Mission(0, fleet, bundle, asked, 50.0, guided=guided)


def test_a_ball_is_no_fence_for_a_robot_of_the_plane(tmp_path):
    bundle = replace(packaged_bundle("navigation"), directory=tmp_path)
    with pytest.raises(ConfigError) as raised:
        mission(bundle)
    assert str(raised.value) == (
        f"{tmp_path}: objectives[0]: geofence cannot be used with motion model 'point_force': its "
        "centre_m has a height, and the robot moves in the plane"
    )
    assert mission(bundle, guided=False).guide().objectives == ()
