"""Commands between frames whose axes point in different directions."""

import math

from msgspec.structs import replace

from edge_runtime.messages import Command, Vector2


def turned(command: Command, angle_rad: float) -> Command:
    """Return the command seen from axes that are turned by minus the angle.

    The action may grow in one component as it turns, but limits hold for each of them: it is shortened so
    that its largest one does not grow.
    """
    action, velocity = _turn(command.action, angle_rad), _turn(command.velocity_m_s, angle_rad)
    before, after = max(map(abs, command.action)), max(map(abs, action))
    if after > before:
        action = action[0] * before / after, action[1] * before / after
    return replace(command, action=action, velocity_m_s=velocity)


def _turn(vector: Vector2, angle_rad: float) -> Vector2:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return cosine * vector[0] - sine * vector[1], sine * vector[0] + cosine * vector[1]
