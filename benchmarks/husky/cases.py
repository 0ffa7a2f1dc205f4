"""What is measured: which robots on which ground, what they are asked, and how they may decide."""

from dataclasses import replace as with_fields
from typing import Final

import msgspec

from benchmarks.paper.candidates import ALONE, METHODS
from benchmarks.paper.settings import Guided, Settings
from benchmarks.paper.tasks import TASKS, Task
from benchmarks.paper.tuning import chosen, read_tuned
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import SafetyMargin, SpeedLimit

FRICTIONS: Final = (0.7, 0.3, 1.0)
"""Of dry ground, of wet, of the best."""
TASK: Final = "navigation"
GUIDED: Final = Guided(guidance=GuidanceSettings(requirement_steps=1), deconfliction=True)


class Asked(msgspec.Struct, frozen=True):
    """What robots of one base are asked, in their metres."""

    scale_m: float
    """One of the policy's metres."""
    limit_m_s: float
    speed_reserve_m_s: float
    """Guidance begins so far below the limit: wheels do a little more than they are told."""
    margin_m: float
    margin_reserve_m: float


ASKED: Final = {
    "husky": Asked(6.0, limit_m_s=0.9, speed_reserve_m_s=0.1, margin_m=1.5, margin_reserve_m=0.12),
    "limo": Asked(2.0, limit_m_s=0.6, speed_reserve_m_s=0.04, margin_m=0.5, margin_reserve_m=0.12),
    "limo_mecanum": Asked(2.0, limit_m_s=0.6, speed_reserve_m_s=0.04, margin_m=0.5, margin_reserve_m=0.12),
}
"""LIMOs are asked what the paper asks, in their metres; Huskies, half its speed, as fast as they can be."""


class Case(msgspec.Struct, frozen=True):
    """Robots of one base, on one ground, that decide in one way."""

    base: str
    robots: int
    friction: float
    method: str


def cases() -> list[Case]:
    """All, our own method first."""
    ours, others = METHODS[0], (*METHODS[1:], *ALONE)
    found = [Case("husky", 4, friction, ours) for friction in FRICTIONS]
    for friction in FRICTIONS:
        teams = ("limo", 4), ("limo_mecanum", 4), ("husky", 16)
        found += [Case(*team, friction, ours) for team in teams]
        found += [Case("husky", 4, friction, way) for way in others]
    return [*found, *(Case("limo", 4, FRICTIONS[0], way) for way in others)]


def task_of(base: str) -> Task:
    """Navigation under what robots of a base are asked, in the policy's metres."""
    asked = ASKED[base]
    unit = asked.scale_m
    speed = SpeedLimit(limit_m_s=asked.limit_m_s / unit, buffer_m_s=asked.speed_reserve_m_s / unit)
    margin = SafetyMargin(distance_m=asked.margin_m / unit, buffer_m=asked.margin_reserve_m / unit)
    return with_fields(TASKS[TASK], objectives=(speed, margin))


def settings_of(method: str) -> Settings:
    """As in the paper's tables; the default sees teammates where they are, and corrects in one step."""
    if method == "CFPG":
        return GUIDED
    return ALONE[method] if method in ALONE else chosen(read_tuned(), TASK, method)
