"""Episodes of the case study through genuine ROS, as they are written and summed up."""

from collections.abc import Sequence
from typing import Final, Literal

import msgspec

from benchmarks.common.result_page import table
from benchmarks.husky.cases import ASKED
from benchmarks.husky.husky_command import TOLERATED
from firmware_bridge.sil.report.records import SilReport

ROBOTS: Final = 4
BASES: Final = {"ros1": "husky", "ros2": "limo"}


class Episode(msgspec.Struct, frozen=True, kw_only=True):
    """One run; lengths and speeds of the points that are steered."""

    bridge: Literal["ros1", "ros2"]
    seed: int
    arrived: bool
    """All were at their goals at the end, and nobody's processes had ended before."""
    contacts: int
    nearest_m: float
    fastest_m_s: float
    broken: float
    """Greatest share of a robot's time in which it was too fast or too near."""
    ticks: float
    """Least share of a robot's ticks that reached its firmware."""
    ended: tuple[str, ...]
    """Processes that ended unasked, and how."""
    disturbed: tuple[str, ...]
    """Why the machine was not quiet."""

    @property
    def margin_kept(self) -> bool:
        """In every moment."""
        return self.nearest_m >= ASKED[BASES[self.bridge]].margin_m

    @property
    def satisfied(self) -> bool:
        """All that is asked at once."""
        return self.arrived and not self.contacts and self.margin_kept and self.broken <= TOLERATED


def judged(report: SilReport, seed: int) -> Episode:
    """What a run came to."""
    robots = report.robots
    return Episode(
        bridge="ros1" if report.bridge == "ros1" else "ros2",
        seed=seed,
        arrived=report.team.goals_reached == report.robots_count and not report.ended,
        contacts=report.team.collisions,
        nearest_m=min(robot.least_distance_m or 0.0 for robot in robots),
        fastest_m_s=max(robot.greatest_speed_m_s for robot in robots),
        broken=max(robot.objective_violations_share for robot in robots),
        ticks=report.team.achieved_rate_share,
        ended=report.ended,
        disturbed=report.disturbed,
    )


def ros_table(episodes: Sequence[Episode]) -> str:
    """Sum up the episodes that prove something in a Markdown table, a line for each ROS."""
    head = ["robots", "ROS", "episodes", "satisfied", "arrived", "without contact", "margin kept"]
    head += ["too fast or near %", "fastest m/s", "nearest m", "ticks %"]
    valid = [one for one in episodes if not one.disturbed]
    found = {bridge: [one for one in valid if one.bridge == bridge] for bridge in BASES}
    return table(head, [_line(bridge, rows) for bridge, rows in found.items() if rows])


def _line(bridge: str, rows: Sequence[Episode]) -> list[str]:
    """Counts of episodes, then the worst of any."""
    return [
        f"{ROBOTS} {BASES[bridge]}",
        bridge[-1],
        f"{len(rows)}",
        f"{sum(one.satisfied for one in rows)}",
        f"{sum(one.arrived for one in rows)}",
        f"{sum(not one.contacts for one in rows)}",
        f"{sum(one.margin_kept for one in rows)}",
        f"{100.0 * max(one.broken for one in rows):.2f}",
        f"{max(one.fastest_m_s for one in rows):.2f}",
        f"{min(one.nearest_m for one in rows):.2f}",
        f"{100.0 * min(one.ticks for one in rows):.1f}",
    ]
