"""How episodes of Balance start: as VMAS 1.5.2 draws them, or in flight, for training."""

import torch
from torch import Tensor

from export.scenarios.vmas_teams import Draw, State

ROBOTS = 5
RADIUS_M = 0.03
PACKAGE_RADIUS_M = 0.05
LINE_LENGTH_M = 0.8
FLOOR_M = -1.0
"""Lowest centre that VMAS lets a robot have."""

FLIGHT_HEIGHT_M = 0.75
"""Flying lines are this far above or below the middle at most."""
FLIGHT_ANGLE_RAD = 0.2
FLIGHT_SPEED_M_S = 0.05
"""Of line and package along each axis; full thrust lifts them at 0.07 m/s."""
ROBOT_SPEED_M_S = 0.25
CONTACT_M = 0.035
"""From a robot's centre to the line that rests on it."""
LARGEST_DEPTH_M = 0.15
"""Half of the flying robots are up to this far below the line, the other half touch it."""


def draw_starts(count: int, flying_share: float, far_share: float, draw: Draw) -> State:
    """Draw ``count`` starts, ``flying_share`` of them in flight on average, ``far_share`` far from the goal.

    Returns:
        Robots, package, goal and line by name: positions and velocities (count, .., 2), angles (count, 1).
    """
    flying = draw.uniform(count, low=0.0) < flying_share
    start, flight = _on_the_floor(draw, count), _in_flight(draw, count)
    for name, value in flight.items():
        start[name][flying] = value[flying]
    far = draw.uniform(count, low=0.0) < far_share
    goal, package = start["goal"][..., 0], start["package"][..., 0]
    start["goal"][..., 0] = torch.where(far, -package.sign() * (0.5 + 0.5 * goal.abs()), goal)
    return start


def _goals(draw: Draw, count: int) -> Tensor:
    return torch.stack([draw.uniform(count), draw.uniform(count, low=0.0)], -1)


def _along_the_line(draw: Draw, count: int) -> Tensor:
    """Where on the line the package lies."""
    return draw.uniform(count) * (LINE_LENGTH_M / 2 - PACKAGE_RADIUS_M)


def _on_the_floor(draw: Draw, count: int) -> State:
    """VMAS' own: at rest, the robots spread evenly on the floor, line and package level above them."""
    nothing = draw.uniform(count) * 0
    line = torch.stack([draw.uniform(count) * (1 - LINE_LENGTH_M / 2), nothing + FLOOR_M + 2 * RADIUS_M], -1)
    package = torch.stack([_along_the_line(draw, count), nothing + PACKAGE_RADIUS_M], -1)
    reach = (LINE_LENGTH_M - RADIUS_M) / 2
    along = torch.linspace(-reach, reach, ROBOTS, device=line.device)
    robots = torch.stack([along, torch.full_like(along, -2 * RADIUS_M)], -1)
    still = torch.zeros_like(line)
    return {
        "position": line[:, None] + robots,
        "velocity": torch.zeros(count, ROBOTS, 2, device=line.device),
        "package": line + package,
        "package_velocity": still.clone(),
        "goal": _goals(draw, count),
        "line": line,
        "line_velocity": still.clone(),
        "line_angle": still[:, :1].clone(),
        "line_angular_velocity": still[:, :1].clone(),
    }


def _in_flight(draw: Draw, count: int) -> State:
    """Everything in the air and in motion; the robots anywhere under the line, clear of each other."""
    line = torch.stack([draw.uniform(count), draw.uniform(count) * FLIGHT_HEIGHT_M], -1)
    angle = draw.uniform(count, 1) * FLIGHT_ANGLE_RAD
    tangent = torch.cat([angle.cos(), angle.sin()], -1)[:, None]
    normal = torch.cat([-angle.sin(), angle.cos()], -1)[:, None]
    package = torch.stack([_along_the_line(draw, count)], -1)
    depth = CONTACT_M + draw.uniform(count, ROBOTS, low=-LARGEST_DEPTH_M, high=LARGEST_DEPTH_M).clamp(min=0)
    velocity = draw.uniform(count, 2) * FLIGHT_SPEED_M_S
    return {
        "position": line[:, None] + _spread(draw, count)[..., None] * tangent - depth[..., None] * normal,
        "velocity": draw.uniform(count, ROBOTS, 2) * ROBOT_SPEED_M_S,
        "package": line + (package[..., None] * tangent + PACKAGE_RADIUS_M * normal)[:, 0],
        "package_velocity": velocity,
        "goal": _goals(draw, count),
        "line": line,
        "line_velocity": velocity.clone(),
        "line_angle": angle,
        "line_angular_velocity": draw.uniform(count, 1) * FLIGHT_ANGLE_RAD,
    }


def _spread(draw: Draw, count: int) -> Tensor:
    """Places (count, N) along the line, uniform among those where no two robots touch."""
    apart = 2 * RADIUS_M
    free = LINE_LENGTH_M - (ROBOTS - 1) * apart
    gaps = draw.uniform(count, ROBOTS, low=0.0, high=free).sort(1).values
    return gaps + apart * torch.arange(ROBOTS, device=gaps.device) - LINE_LENGTH_M / 2
