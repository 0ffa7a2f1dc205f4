"""Bases that no other model describes: the linear gains of one control step, as the manifest gives them."""

from collections.abc import Iterator
from typing import Literal

from msgspec.structs import replace

from edge_runtime.common.bounds import GREATEST
from edge_runtime.messages import LONGEST_ACTION
from edge_runtime.motion.linear import Axis, Row
from edge_runtime.motion.model import Fault, LinearModel, not_positive, outside

SMALL = 1e-5
"""Share of the velocity lost in a step below which differences would lose their digits."""


class LinearTable(LinearModel, frozen=True, tag="table"):
    """One step along each axis is given by gains, under an action u of d components.

    v' = velocity_decay v + velocity_gain . u
    p' = p + position_decay v + position_gain . u

    There is one entry or row for each of x, y and, in space, z. With gains of the yaw rate and the heading
    the robot turns by the same equations.
    """

    dt_s: float
    """Of one control step."""
    velocity_decay: Row
    """(dims,), each in [0, 1]."""
    velocity_gain: tuple[Row, ...]
    """(dims, d)"""
    position_decay: Row
    """(dims,) in s."""
    position_gain: tuple[Row, ...]
    """(dims, d)"""
    dims: Literal[2, 3] = 2
    """2 in the plane, 3 in space."""
    yaw_rate_decay: float = 0.0
    """As ``velocity_decay``, of the yaw rate."""
    yaw_rate_gain: Row = ()
    """(d,), or empty for a robot that does not turn."""
    heading_decay: float = 0.0
    """As ``position_decay``, of the heading."""
    heading_gain: Row = ()
    """(d,) as ``yaw_rate_gain``."""

    @property
    def turns(self) -> bool:
        """See `Model.turns`."""
        return bool(self.yaw_rate_gain)

    @property
    def action_dim(self) -> int:
        """See `Model.action_dim`."""
        return len(self.velocity_gain[0])

    def axes(self) -> tuple[Axis, ...]:
        """See `LinearModel.axes`."""
        rows = (self.velocity_decay, self.velocity_gain, self.position_decay, self.position_gain)
        axes = [Axis(*row) for row in zip(*rows, strict=True)]
        if self.turns:
            turn = (self.yaw_rate_decay, self.yaw_rate_gain, self.heading_decay, self.heading_gain)
            axes.append(Axis(*turn))
        return tuple(axes)

    def at_period(self, period_s: float) -> "LinearTable":
        """See `Model.at_period`: with as many steps as make up the period, or the share of one step."""
        axes = [_after(axis, period_s / self.dt_s) for axis in self.axes()]
        places, turn = axes[: self.dims], (axes[self.dims] if self.turns else Axis(0.0, (), 0.0, ()))
        return LinearTable(
            dt_s=period_s,
            velocity_decay=tuple(axis.velocity_decay for axis in places),
            velocity_gain=tuple(axis.velocity_gain for axis in places),
            position_decay=tuple(axis.position_decay for axis in places),
            position_gain=tuple(axis.position_gain for axis in places),
            dims=self.dims,
            yaw_rate_decay=turn.velocity_decay,
            yaw_rate_gain=turn.velocity_gain,
            heading_decay=turn.position_decay,
            heading_gain=turn.position_gain,
        )

    def scaled(self, scale_m: float) -> "LinearTable":
        """See `Model.scaled`."""

        def scaled(rows: tuple[Row, ...]) -> tuple[Row, ...]:
            return tuple(tuple(scale_m * value for value in row) for row in rows)

        return replace(
            self, velocity_gain=scaled(self.velocity_gain), position_gain=scaled(self.position_gain)
        )

    def faults(self) -> Iterator[Fault]:
        """See `Model.faults`."""
        yield from not_positive("dt_s", self.dt_s)
        for key in ("velocity_decay", "velocity_gain", "position_decay", "position_gain"):
            if len(getattr(self, key)) != self.dims:
                yield key, getattr(self, key), f"{self.dims} of them, one an axis"
                return
        d = self.action_dim
        yield from outside("velocity_gain: number of columns", d, 1, LONGEST_ACTION)
        rows = [
            (f"{key}[{i}]", row)
            for key in ("velocity_gain", "position_gain")
            for i, row in enumerate(getattr(self, key))
        ]
        if self.yaw_rate_gain or self.heading_gain:
            rows += [(key, getattr(self, key)) for key in ("yaw_rate_gain", "heading_gain")]
        for key, row in rows:
            if len(row) != d or not all(abs(value) <= GREATEST for value in row):
                yield key, row, f"{d} numbers of at most {GREATEST:g}, one for each component of the action"
        for key, most in (("velocity_decay", 1.0), ("position_decay", GREATEST)):
            for i, value in enumerate(getattr(self, key)):
                yield from outside(f"{key}[{i}]", value, 0.0, most)
        yield from outside("yaw_rate_decay", self.yaw_rate_decay, 0.0, 1.0)
        yield from outside("heading_decay", self.heading_decay, 0.0, GREATEST)
        if not any(map(any, (*self.velocity_gain, *self.position_gain))):
            yield "position_gain", self.position_gain, "not zero throughout: no action would move the robot"


def _after(axis: Axis, steps: float) -> Axis:
    """The axis of so many steps, which need not be whole: `Axis.after` in closed form.

    With k the velocity's decay, kept over n steps is k^n, added up it is S = (1 - k^n) / (1 - k), and
    added up once more (n - S) / (1 - k); where hardly any is lost, the first terms of their binomial series.
    """
    kept, lost = axis.velocity_decay**steps, 1.0 - axis.velocity_decay
    if lost > SMALL:
        total = (1.0 - kept) / lost
        twice = (steps - total) / lost
    else:
        twice = steps * (steps - 1.0) / 2.0 * (1.0 - lost * (steps - 2.0) / 3.0)
        total = steps - lost * twice
    pairs = zip(axis.velocity_gain, axis.position_gain, strict=True)
    return Axis(
        kept,
        tuple(total * push for push in axis.velocity_gain),
        total * axis.position_decay,
        tuple(steps * shift + twice * axis.position_decay * push for push, shift in pairs),
    )
