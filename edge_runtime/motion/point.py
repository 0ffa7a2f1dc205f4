"""Points that forces or accelerations push, as VMAS integrates them.

Drag takes its share of the velocity once a control step, then ``substeps`` semi-implicit Euler steps of
h = ``dt_s / substeps`` apply the action u,

    v <- (1 - drag) v,   then repeatedly   v <- v + g u h,   p <- p + v h,

with g = 1 / mass for forces. Torques and angular accelerations turn the heading likewise. With g 1 and no
drag this is the paper's v' = v + a dt, p' = p + v' dt (section III).
"""

from collections.abc import Iterator
from typing import Literal

from msgspec.structs import replace

from edge_runtime.motion.linear import Axis
from edge_runtime.motion.model import Fault, LinearModel, no_share, not_positive, outside, unit_rows

MOST_SUBSTEPS = 100


def _pushed(row: tuple[float, ...], mass: float, drag: float, dt_s: float, substeps: int) -> Axis:
    """One axis in one step; ``row`` says which component pushes it."""
    keep, gain = 1.0 - drag, dt_s / mass
    # Position after S substeps of a ramping velocity: dt v plus the mean of the ramp, (S + 1) / (2 S).
    shift = dt_s * (substeps + 1) / (2 * substeps) * gain
    return Axis(keep, tuple([gain * u for u in row]), dt_s * keep, tuple([shift * u for u in row]))


def _drag_at(drag: float, periods: float) -> float:
    """The drag of a step of so many periods: compounded."""
    return 1.0 - (1.0 - drag) ** periods


class PointForce(LinearModel, frozen=True, tag="point_force"):
    """Moved by a force along each axis, in N; with an inertia, turned by a torque, in N m."""

    mass_kg: float
    """What divides the force."""
    drag: float
    """Share of the velocity lost in one step, in [0, 1)."""
    dt_s: float
    """Of one control step."""
    substeps: int = 1
    """In which a control step is integrated."""
    dims: Literal[2, 3] = 2
    """2 in the plane, 3 in space."""
    inertia_kg_m2: float | None = None
    """Of one whose action ends with a torque."""
    yaw_drag: float = 0.0
    """Share of the yaw rate lost in one step."""

    @property
    def turns(self) -> bool:
        """See `Model.turns`."""
        return self.inertia_kg_m2 is not None

    def axes(self) -> tuple[Axis, ...]:
        """See `LinearModel.axes`."""
        rows, step = unit_rows(self.action_dim), (self.dt_s, self.substeps)
        axes = [_pushed(row, self.mass_kg, self.drag, *step) for row in rows[: self.dims]]
        if self.inertia_kg_m2 is not None:
            axes.append(_pushed(rows[-1], self.inertia_kg_m2, self.yaw_drag, *step))
        return tuple(axes)

    def at_period(self, period_s: float) -> "PointForce":
        """See `Model.at_period`: drag is compounded, mass stays."""
        drag, yaw_drag = (_drag_at(share, period_s / self.dt_s) for share in (self.drag, self.yaw_drag))
        return replace(self, drag=drag, yaw_drag=yaw_drag, dt_s=period_s)

    def scaled(self, scale_m: float) -> "PointForce":
        """See `Model.scaled`."""
        return replace(self, mass_kg=self.mass_kg / scale_m)

    def faults(self) -> Iterator[Fault]:
        """See `Model.faults`."""
        yield from not_positive("mass_kg", self.mass_kg)
        yield from no_share("drag", self.drag)
        yield from not_positive("dt_s", self.dt_s)
        yield from outside("substeps", self.substeps, 1, MOST_SUBSTEPS)
        yield from no_share("yaw_drag", self.yaw_drag)
        if self.inertia_kg_m2 is not None:
            yield from not_positive("inertia_kg_m2", self.inertia_kg_m2)
        elif self.yaw_drag:
            yield "yaw_drag", self.yaw_drag, "0 without inertia_kg_m2"


class PointAcceleration(LinearModel, frozen=True, tag="point_acceleration"):
    """Moved by an acceleration along each axis; where it is angular, turned by one more, in rad/s^2."""

    dt_s: float
    """Of one control step."""
    drag: float = 0.0
    """Share of the velocity lost in one step, in [0, 1)."""
    substeps: int = 1
    """In which a control step is integrated."""
    dims: Literal[2, 3] = 2
    """2 in the plane, 3 in space."""
    angular: bool = False
    """Whether the action ends with an angular acceleration, as the paper's (a_x, a_y, alpha) does."""
    yaw_drag: float = 0.0
    """Share of the yaw rate lost in one step."""
    gain: float = 1.0
    """What one unit of the action along an axis is, in m/s^2."""

    @property
    def turns(self) -> bool:
        """See `Model.turns`."""
        return self.angular

    def axes(self) -> tuple[Axis, ...]:
        """See `LinearModel.axes`."""
        rows, step = unit_rows(self.action_dim), (self.dt_s, self.substeps)
        axes = [_pushed(row, 1.0 / self.gain, self.drag, *step) for row in rows[: self.dims]]
        if self.angular:
            axes.append(_pushed(rows[-1], 1.0, self.yaw_drag, *step))
        return tuple(axes)

    def at_period(self, period_s: float) -> "PointAcceleration":
        """See `Model.at_period`: drag is compounded."""
        drag, yaw_drag = (_drag_at(share, period_s / self.dt_s) for share in (self.drag, self.yaw_drag))
        return replace(self, drag=drag, yaw_drag=yaw_drag, dt_s=period_s)

    def scaled(self, scale_m: float) -> "PointAcceleration":
        """See `Model.scaled`."""
        return replace(self, gain=self.gain * scale_m)

    def faults(self) -> Iterator[Fault]:
        """See `Model.faults`."""
        yield from not_positive("dt_s", self.dt_s)
        yield from no_share("drag", self.drag)
        yield from outside("substeps", self.substeps, 1, MOST_SUBSTEPS)
        yield from no_share("yaw_drag", self.yaw_drag)
        yield from not_positive("gain", self.gain)
        if self.yaw_drag and not self.angular:
            yield "yaw_drag", self.yaw_drag, "0 unless angular"
