"""What is asked of a team at execution time, as an objectives file says it: records, nothing that computes.

Two words stand for the objectives in force, everywhere: an `ObjectiveSet` is what somebody asks for; a
`edge_runtime.guidance.guide.Guide` is the same made ready for one robot, under the version that its team
knows it by.
"""

import math
from typing import Final, Literal

import msgspec

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.objectives import Objective, SafetyMargin, SpeedLimit

PREFERENCE_STEPS: Final = 5
PREFERENCE_RATE: Final = 0.5
"""Preferences correct a finished action by so many steps of this share of a Newton step each: several
preferences settle on a compromise, where one step of each would overshoot."""

MOST_STEPS: Final = 100
"""Of a correction: more would only take time."""

Mode = Literal["none", "hierarchical", "cone", "terminal", "correction"]
"""``terminal`` is ``hierarchical`` with the correction at tau = 1, ``correction`` that correction of a flow
that is left alone; the others name their projection."""


class GuidanceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How strongly objectives steer, and how their conflicts are resolved.

    Raises:
        ValueError: if a number is negative, not finite or absurdly large.
    """

    mode: Mode = "terminal"
    """How conflicts are resolved: the projection, and whether the finished action is corrected."""
    scale: float = 0.3
    """eta of eq. 10; mode ``correction`` knows only whether it is zero."""
    reach: float = 0.5
    """How far preferences (formations, clusters) may move the finished action, in units of the action;
    requirements move it as far as it takes. Modes ``terminal`` and ``correction`` only."""
    goal_reach: float | None = None
    """The same where every tracked object that has a goal is within ``goal_within_m`` of it; None for
    ``reach`` there, too. A load that is still under way is carried by the policy, one that is there can be
    held in any formation."""
    goal_within_m: float = 0.1
    """How near that is."""
    requirement_steps: int = 5
    """In so many Newton steps at most requirements move it: one alone takes one, those that bind at once two
    or three. Where the motion model is not linear, it is one. Modes ``terminal`` and ``correction`` only."""
    start_noise: float = 1.0
    """Deviation of the Gaussian that the flow starts from: 1 is the paper's prior, 0 its mean."""
    ease_m: float = 0.0
    """While a safety margin of two radii or more corrects the actions, the policy sees teammates this much
    farther away by its ranges than they are, and leaves the distance to the margin: of two policies that shy
    away from each other, neither passes. Real readings, which may be of anything, stay as they are."""

    def __post_init__(self) -> None:
        numbers = ("scale", "reach", "goal_reach", "goal_within_m", "start_noise", "ease_m")
        for field in numbers:
            value = getattr(self, field)
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"`{field}` must be finite and not negative, got {value}")
        check_bounds(self, {**dict.fromkeys(numbers, (0.0, GREATEST)), "requirement_steps": (1, MOST_STEPS)})


class ObjectiveSet(msgspec.Struct, frozen=True):
    """Objectives and how they are to guide: all that an objectives file holds."""

    objectives: tuple[Objective, ...] = ()
    guidance: GuidanceSettings = GuidanceSettings()

    @property
    def speed_limit_m_s(self) -> float | None:
        """The least speed limit among them; None without one."""
        limits = (each.limit_m_s for each in self.objectives if isinstance(each, SpeedLimit))
        return min(limits, default=None)

    @property
    def margin_m(self) -> float | None:
        """The greatest safety margin among them; None without one."""
        margins = (each.distance_m for each in self.objectives if isinstance(each, SafetyMargin))
        return max(margins, default=None)

    @property
    def text(self) -> str:
        """What they ask for, for a person."""
        return ", ".join(f"{each.name} {each.asks}".strip() for each in self.objectives) or "none"
