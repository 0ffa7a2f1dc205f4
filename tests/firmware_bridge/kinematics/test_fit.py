import pytest

from edge_runtime.errors import ConfigError
from edge_runtime.motion.models import PointAcceleration, PointForce, Unicycle, VelocityLag
from firmware_bridge.kinematics.base import Base
from firmware_bridge.kinematics.fit import check_base, check_fit

FLYING = PointForce(1.0, 0.0, 0.05, dims=3)
RIGID = PointAcceleration(drag=0.0, dt_s=0.05, angular=True)
PLANAR = VelocityLag(time_constant_s=0.1, dt_s=0.05)
ROLLING = Unicycle(0.05)


@pytest.mark.parametrize("motion", [PLANAR, ROLLING])
def test_every_base_of_the_plane_takes(motion):
    check_fit(motion, "it", sideways=False)


@pytest.mark.parametrize("motion", [PLANAR, ROLLING, RIGID, FLYING])
def test_what_flies_takes(motion):
    check_fit(motion, "it", sideways=True, space=True)


def test_what_a_base_cannot_do_is_said_in_one_line():
    with pytest.raises(ConfigError, match=r"in space \(point_force\): my base moves in the plane alone"):
        check_fit(FLYING, "my base", sideways=True)
    with pytest.raises(ConfigError, match=r"which my base cannot: it takes unicycle policies"):
        check_fit(RIGID, "my base", sideways=False)


def test_a_profiles_base_is_named():
    with pytest.raises(ConfigError, match=r"which the differential base of husky\.toml cannot"):
        check_base(RIGID, Base("differential"), "husky.toml")
    check_base(RIGID, Base("omnidirectional"), "limo.toml")
    check_base(ROLLING, Base("differential", "turn"), "husky.toml")
    with pytest.raises(
        ConfigError, match=r"base.sideways is 'turn', but the policy \(velocity\) does not turn"
    ):
        check_base(PLANAR, Base("differential", "turn"), "husky.toml")
