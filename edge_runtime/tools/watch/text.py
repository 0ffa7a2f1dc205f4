"""What the view and the plain lines say alike: cells of a robot's row, each with whether it is good."""

import math
from typing import NamedTuple

from edge_runtime.telemetry.status import ObjectiveStatus, Span, Status
from edge_runtime.tools.watch.team import WatchedTeam

CLOCK_TOLERANCE_S = 10.0
"""A robot's clock that is further off is shown: it may be a recording."""


class Cell(NamedTuple):
    """A text, and whether what it says is as it should be; None where it is neither."""

    text: str
    good: bool | None = None


def state(team: WatchedTeam, robot_id: int) -> Cell:
    """Whether a robot drives, stands, is silent, or was never heard."""
    heard = team.heard[robot_id]
    if heard is None:
        return Cell("not heard yet", False)
    if heard.status.ended:
        return Cell(f"ended: {heard.status.ended}")
    if team.silent(robot_id):
        return Cell(f"silent for {team.age_s(heard):.0f} s", False)
    if abs(heard.clock_ahead_s) > CLOCK_TOLERANCE_S:
        return Cell(f"clock {heard.clock_ahead_s:+.0f} s off", False)
    if heard.status.stop_reason:
        return Cell("stopped", False)
    return Cell("driving", True)


def goal(status: Status) -> Cell:
    """Distance to the goal."""
    return Cell("-" if status.goal_distance_m is None else f"{status.goal_distance_m:.2f}")


def speed(status: Status) -> Cell:
    """Speed over its limit."""
    if status.velocity_m_s is None:
        return Cell("-")
    value, limit = math.hypot(*status.velocity_m_s), status.speed_limit_m_s
    if limit is None:
        return Cell(f"{value:.2f}")
    return Cell(f"{value:.2f}/{limit:.2f}", value <= limit)


def body(status: Status) -> str:
    """Height and yaw rate, of robots that have one; empty for the others."""
    told = []
    if status.position_m is not None and len(status.position_m) == 3:
        told.append(f"height {status.position_m[2]:.2f} m")
    if status.yaw_rate_rad_s and status.heading_rad is not None:
        told.append(f"heading {status.heading_rad:.2f} rad, turning {status.yaw_rate_rad_s:+.2f} rad/s")
    return ", ".join(told)


def nearest(status: Status) -> Cell:
    """Distance to the nearest teammate over the margin."""
    value, margin = status.nearest_m, status.margin_m
    if value is None:
        return Cell("-")
    if margin is None:
        return Cell(f"{value:.2f}")
    return Cell(f"{value:.2f}/{margin:.2f}", value >= margin)


def rate(status: Status) -> Cell:
    """Ticks per second over what was asked for."""
    return Cell(f"{status.rate_hz:.1f}/{status.nominal_rate_hz:g}")


def missed(status: Status) -> Cell:
    """Deadlines missed since the start."""
    return Cell(str(status.missed), None if status.missed == 0 else False)


def unfamiliar(status: Status) -> str:
    """How many observations were unlike those of training, and what is now."""
    now = f", {status.unfamiliar} now" if status.unfamiliar else ""
    return f"{status.unfamiliar_ticks} unfamiliar observations{now}"


def milliseconds(span: Span) -> str:
    """Median and 99th percentile."""
    return f"{_three_digits(span.p50 / 1e3)}/{_three_digits(span.p99 / 1e3)}"


def objective(item: ObjectiveStatus) -> Cell:
    """What an objective asks, its cost, and its conflicts if it has any."""
    cost = f"{item.cost:.3f}" if item.cost < 100.0 else f"{item.cost:.2g}"
    parts = [item.limit, cost, f"{item.conflicts:.0%}" if item.conflicts else ""]
    return Cell("  ".join(filter(None, parts)), item.cost == 0.0 or None)


def _three_digits(value: float) -> str:
    return f"{value:.{2 if value < 9.995 else 1 if value < 99.95 else 0}f}"
