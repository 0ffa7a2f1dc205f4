"""Commands between frames whose axes point in different directions."""

import math

from msgspec.structs import replace

from edge_runtime.messages import Command, Vector


def turned(command: Command, angle_rad: float) -> Command:
    """Return the command seen from axes that are turned by minus the angle.

    The action may grow in one component as it turns, but limits hold for each of them: it is shortened so
    that its largest one does not grow.
    """
    action, velocity = _turn(command.action, angle_rad), _turn(command.velocity_m_s, angle_rad)
    before, after = max(map(abs, command.action)), max(map(abs, action))
    if after > before:
        action = tuple(component * before / after for component in action)
    return replace(command, action=action, velocity_m_s=velocity)


def _turn(vector: Vector, angle_rad: float) -> Vector:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    x, y, *rest = vector
    return cosine * x - sine * y, sine * x + cosine * y, *rest
