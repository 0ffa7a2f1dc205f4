"""The bases that the plant knows: what their makers publish of bodies, wheels and wheel controllers."""

import math
from collections.abc import Mapping
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_bridge.kinematics.base import Base, BaseMotion

Vector3 = tuple[float, float, float]
WHEELS: Final = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Front left, front right, rear left, rear right: ahead and to the left of the base's middle."""


class WheeledBase(msgspec.Struct, frozen=True):
    """A base on four wheels, two a side."""

    kinematics: Base
    """What its robots' profiles say; its point of reference is what teams steer and see."""
    size_m: Vector3
    """Of the box by which robots touch, which holds body and wheels: length, width, height."""
    clearance_m: float
    """From the ground to that box."""
    body_kg: float
    """Without wheels."""
    centre_m: Vector3
    """Of the body's mass, from the middle between the axles."""
    inertia_kg_m2: Vector3
    """Of the body, about that."""
    wheel_kg: float
    wheel_radius_m: float
    wheel_width_m: float
    wheelbase_m: float
    track_m: float
    separation_multiplier: float
    """By which the wheel controller lengthens the track, so that a base that skids turns as it is told."""
    max_speed_m_s: float
    acceleration_m_s2: float
    """Greatest change of the controller's speed, and of its yaw rate below, in a second."""
    yaw_acceleration_rad_s2: float

    @property
    def mecanum(self) -> bool:
        """Whether its wheels carry rollers at 45 degrees, which let it move sideways."""
        return self.kinematics.kind == "omnidirectional"

    @property
    def mass_kg(self) -> float:
        """Of body and wheels."""
        return self.body_kg + 4 * self.wheel_kg

    @property
    def hull_radius_m(self) -> float:
        """Of the smallest disc that holds the base."""
        return math.hypot(*self.size_m[:2]) / 2

    @property
    def separation_m(self) -> float:
        """What the wheel controller takes for the distance between left and right."""
        across_m = self.wheelbase_m if self.mecanum else 0.0
        return self.separation_multiplier * self.track_m + across_m

    def rim_speeds_m_s(self, motion: BaseMotion) -> tuple[float, float, float, float]:
        """Speeds of the wheels' rims, front left, front right, rear left and rear right, for a motion.

        The base's inverse kinematics as its wheel controller has them, which knows of no slip.
        """
        forward, left = motion.forward_m_s, motion.lateral_m_s
        turn = motion.yaw_rad_s * self.separation_m / 2
        return forward - left - turn, forward + left + turn, forward + left - turn, forward - left + turn


_HUSKY: Final = WheeledBase(
    kinematics=Base("differential", sideways="lookahead", lookahead_m=0.4, max_yaw_rad_s=1.0),
    size_m=(0.99, 0.67, 0.2577),
    clearance_m=0.1323,
    body_kg=46.034,
    centre_m=(-0.00065, 0.0, 0.0292),
    inertia_kg_m2=(0.6022, 1.7386, 2.0296),
    wheel_kg=2.637,
    wheel_radius_m=0.1651,
    wheel_width_m=0.1143,
    wheelbase_m=0.512,
    track_m=0.5708,
    separation_multiplier=1.875,
    max_speed_m_s=1.0,
    acceleration_m_s2=3.0,
    yaw_acceleration_rad_s2=6.0,
)
"""Clearpath Husky A200: the data sheet's size, else husky_description and control.yaml of husky/husky,
noetic-devel; its body's mass lies amidships here."""
_LIMO: Final = WheeledBase(
    kinematics=Base("differential", sideways="lookahead", lookahead_m=0.1, max_yaw_rad_s=2.0),
    size_m=(0.322, 0.22, 0.227),
    clearance_m=0.024,
    body_kg=2.1557,
    centre_m=(0.0, 0.0, 0.03),
    inertia_kg_m2=(0.0179, 0.0279, 0.0273),
    wheel_kg=0.5,
    wheel_radius_m=0.045,
    wheel_width_m=0.045,
    wheelbase_m=0.2,
    track_m=0.172,
    separation_multiplier=2.352,
    max_speed_m_s=1.0,
    acceleration_m_s2=1.0,
    yaw_acceleration_rad_s2=6.0,
)
"""AgileX LIMO, steered by its wheels' difference: limo_description of agilexrobotics/limo_ros2, with a box's
inertia. What its firmware makes of a yaw rate nobody tells: it is taken to turn as told, by the multiplier
1 + (wheelbase / track)^2 that Coulomb's friction asks for."""
BASES: Final[Mapping[str, WheeledBase]] = {
    "husky": _HUSKY,
    "limo": _LIMO,
    "limo_mecanum": replace(
        _LIMO, kinematics=Base("omnidirectional", max_yaw_rad_s=2.0), separation_multiplier=1.0
    ),
}
