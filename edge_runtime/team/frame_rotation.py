"""Commands between frames whose axes point in different directions."""

import math

import msgspec
from msgspec.structs import replace

from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, Vector
from edge_runtime.motion.models import LinearTable, Unicycle
from edge_runtime.policy.manifest import Manifest


class ActionAxes(msgspec.Struct, frozen=True):
    """What an action's components are to the frame's axes."""

    along: bool = True
    """Whether the first two are those of a vector along x and y; else none depends on the frame."""
    low: Vector = (-math.inf, -math.inf)
    """Least action."""
    high: Vector = (math.inf, math.inf)
    """Greatest action."""


def action_axes(manifest: Manifest) -> ActionAxes:
    """Return those of a policy.

    Raises:
        ConfigError: if the action of its motion model cannot be turned.
    """
    if isinstance(manifest.motion, LinearTable):
        raise ConfigError(
            "the motion model (table) holds along the team's axes: a base with a pose stream has others"
        )
    low, high = ([getattr(field, end) for field in manifest.action] for end in ("low", "high"))
    return ActionAxes(not isinstance(manifest.motion, Unicycle), tuple(low), tuple(high))


def turned(command: Command, angle_rad: float, axes: ActionAxes) -> Command:
    """Return the command seen from axes that are turned by minus the angle.

    The action may grow in one component as it turns, but limits hold for each of them: its part in the plane
    is shortened so that they are kept.
    """
    velocity = _turn(command.velocity_m_s, angle_rad)
    if not axes.along:
        return replace(command, velocity_m_s=velocity)
    x, y, *others = _turn(command.action, angle_rad)
    share = min(_kept(number, *limits) for number, *limits in zip((x, y), axes.low, axes.high, strict=False))
    return replace(command, action=(share * x, share * y, *others), velocity_m_s=velocity)


def _kept(number: float, low: float, high: float) -> float:
    """The share of a component that its limits leave; 0 lies within them."""
    limit = high if number > 0.0 else low
    return limit / number if abs(number) > abs(limit) else 1.0


def _turn(vector: Vector, angle_rad: float) -> Vector:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    x, y, *rest = vector
    return cosine * x - sine * y, sine * x + cosine * y, *rest
