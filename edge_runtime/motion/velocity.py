"""Bases that follow a velocity setpoint in the team's frame, at once or with a lag."""

import math
from collections.abc import Iterator
from typing import Literal

from msgspec.structs import replace

from edge_runtime.common.bounds import GREATEST
from edge_runtime.motion.linear import Axis
from edge_runtime.motion.model import Fault, LinearModel, not_positive, outside, unit_rows


def _following(row: tuple[float, ...], gain: float, time_constant_s: float, dt_s: float) -> Axis:
    """dv/dt = (gain u - v) / time_constant_s with u held, solved exactly for one step."""
    keep = math.exp(-dt_s / time_constant_s) if time_constant_s else 0.0
    reach = time_constant_s * (1.0 - keep)
    return Axis(
        keep,
        tuple([(1.0 - keep) * gain * u for u in row]),
        reach,
        tuple([(dt_s - reach) * gain * u for u in row]),
    )


class VelocityLag(LinearModel, frozen=True, tag="velocity"):
    """Follows a velocity along each axis; where it is angular, a yaw rate in rad/s as well."""

    dt_s: float
    """Of one control step."""
    time_constant_s: float = 0.0
    """Of the first-order lag; 0 follows at once."""
    dims: Literal[2, 3] = 2
    """2 in the plane, 3 in space."""
    angular: bool = False
    """Whether the action ends with a yaw rate."""
    yaw_time_constant_s: float = 0.0
    """Of the yaw rate; 0 follows at once."""
    gain: float = 1.0
    """What one unit of the action along an axis is, in m/s."""

    @property
    def turns(self) -> bool:
        """See `Model.turns`."""
        return self.angular

    def axes(self) -> tuple[Axis, ...]:
        """See `LinearModel.axes`."""
        rows = unit_rows(self.action_dim)
        axes = [_following(row, self.gain, self.time_constant_s, self.dt_s) for row in rows[: self.dims]]
        if self.angular:
            axes.append(_following(rows[-1], 1.0, self.yaw_time_constant_s, self.dt_s))
        return tuple(axes)

    def at_period(self, period_s: float) -> "VelocityLag":
        """See `Model.at_period`: exact."""
        return replace(self, dt_s=period_s)

    def scaled(self, scale_m: float) -> "VelocityLag":
        """See `Model.scaled`."""
        return replace(self, gain=self.gain * scale_m)

    def faults(self) -> Iterator[Fault]:
        """See `Model.faults`."""
        yield from not_positive("dt_s", self.dt_s)
        for key in ("time_constant_s", "yaw_time_constant_s"):
            yield from outside(key, getattr(self, key), 0.0, GREATEST)
        yield from not_positive("gain", self.gain)
        if self.yaw_time_constant_s and not self.angular:
            yield "yaw_time_constant_s", self.yaw_time_constant_s, "0 unless angular"
