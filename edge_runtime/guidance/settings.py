"""What steers the flow: the settings of guidance, and objectives made ready for one kind of robot."""

import math
from collections.abc import Sequence
from typing import Literal

import msgspec

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.guidance.projection import BATCH, PLANAR, Projection
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.objectives import Objective
from edge_runtime.policy.compiled_policy import MAX_TERMS, encodable

Mode = Literal["none", "hierarchical", "cone", "terminal"]
"""``terminal`` is ``hierarchical`` with the correction at tau = 1; the others name their projection."""

PREFERENCE_STEPS = 5
PREFERENCE_RATE = 0.5
"""Preferences correct a finished action by so many steps of this share of a Newton step each: several
preferences settle on a compromise, where one step of each would overshoot."""

TINY = 1e-300
"""Keeps a length of zero from dividing."""


class GuidanceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How strongly objectives steer, and how their conflicts are resolved.

    Raises:
        ValueError: if the scale, the reach or the start noise is negative, not finite or absurdly large.
    """

    mode: Mode = "terminal"
    scale: float = 10.0
    """eta of eq. 10."""
    reach: float = 0.5
    """How far preferences (formations, clusters) may move the finished action, in units of the action;
    requirements move it as far as it takes. Mode ``terminal`` only."""
    start_noise: float = 1.0
    """Deviation of the Gaussian that the flow starts from: 1 is the paper's prior, 0 its mean."""

    def __post_init__(self) -> None:
        for field in ("scale", "reach", "start_noise"):
            value = getattr(self, field)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"`{field}` must be finite and not negative, got {value}")
        check_bounds(self, dict.fromkeys(("scale", "reach", "start_noise"), (0.0, GREATEST)))


class Guide:
    """Objectives made ready for one kind of robot: their previews and factors, computed once.

    Args:
        settings: mode and scale.
        objectives: M execution objectives; none of them, or a scale of 0, leaves the flow unguided.
        dynamics: how the robot moves under the policy's action.
    """

    def __init__(
        self, settings: GuidanceSettings, objectives: Sequence[Objective], dynamics: Dynamics
    ) -> None:
        active = [objective for objective in objectives if settings.scale * objective.weight > 0.0]
        self.objectives = tuple(active)
        self.previews = tuple(dynamics.preview(objective.look_ahead) for objective in active)
        self.factors = tuple(settings.scale * objective.weight for objective in active)
        self.projection: Projection = "hierarchical" if settings.mode == "terminal" else settings.mode
        self.combine = PLANAR[self.projection]
        self.keeps_flow = self.projection == "hierarchical"
        """Whether eq. 15 removes what opposes the flow."""
        self.combine_batch = BATCH[self.projection]
        self.corrects = settings.mode == "terminal" and bool(active)
        """Whether the finished action is corrected at tau = 1."""
        corrected = range(len(active)) if self.corrects else range(0)
        self.preferences = tuple(m for m in corrected if active[m].preference)
        """Objectives that move it by ``reach`` at most, by their places."""
        self.requirements = tuple(m for m in corrected if not active[m].preference)
        """Objectives that move it as far as it takes."""
        self.preference_weights = tuple(active[m].weight for m in self.preferences)
        self.reach = settings.reach
        self.native = len(active) <= MAX_TERMS and all(map(encodable, active))
        """Whether the compiled kernel can run the whole flow."""
