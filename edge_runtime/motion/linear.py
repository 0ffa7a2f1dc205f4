"""Linear motion, axis by axis: its gains some steps ahead are constant, and computed once."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from edge_runtime.common.vectors import new_tuple
from edge_runtime.messages import RobotState
from edge_runtime.motion.prediction import Columns, PredictedMotion, Preview, pulled_back

Row = tuple[float, ...]
"""One number for each of d action components."""


class Axis(msgspec.Struct, frozen=True, gc=False):
    """One axis, x, y, z or the heading, some steps ahead under a constant action u (d,).

    v' = velocity_decay v + velocity_gain . u
    p' = p + position_decay v + position_gain . u
    """

    velocity_decay: float
    velocity_gain: Row
    position_decay: float
    """dp'/dv in seconds."""
    position_gain: Row

    def after(self, steps: int) -> "Axis":
        """This axis, that of one step, after so many.

        Raises:
            ValueError: if ``steps`` is below one.
        """
        if steps < 1:
            raise ValueError(f"a preview looks at least one step ahead, got {steps}")
        keep, reach = self.velocity_decay, self.position_decay
        velocity_decay, position_decay = 1.0, 0.0
        velocity_gain = position_gain = (0.0,) * len(self.velocity_gain)
        for _ in range(steps):
            position_decay += reach * velocity_decay
            position_gain = _sum(position_gain, _sum(_scaled(reach, velocity_gain), self.position_gain))
            velocity_decay *= keep
            velocity_gain = _sum(_scaled(keep, velocity_gain), self.velocity_gain)
        return Axis(velocity_decay, velocity_gain, position_decay, position_gain)


def _sum(a: Row, b: Row) -> Row:
    return tuple([x + y for x, y in zip(a, b, strict=True)])


def _scaled(factor: float, row: Row) -> Row:
    return tuple([factor * value for value in row])


def preview_of(axes: Sequence[Axis], dims: int) -> Preview:
    """The preview of these axes: those of the plane or of space, and then perhaps the heading's."""
    places, turn = axes[:dims], axes[dims:]
    rows = [axis.position_gain for axis in places[:2]] + [axis.velocity_gain for axis in places[:2]]
    if dims == 3 or turn:
        nothing = (0.0,) * len(rows[0])
        rows += [places[2].position_gain, places[2].velocity_gain] if dims == 3 else [nothing, nothing]
    if turn:
        rows += [turn[0].position_gain, turn[0].velocity_gain]
    gains = (
        _greatest([axis.position_gain for axis in places]),
        _greatest([axis.velocity_gain for axis in places]),
    )
    columns = tuple(zip(*rows, strict=True))
    x, y, *others = axes
    decays = (x.velocity_decay, x.position_decay)
    alike = not others and decays == (y.velocity_decay, y.position_decay)
    if alike and columns == ((gains[0], 0.0, gains[1], 0.0), (0.0, gains[0], 0.0, gains[1])):
        return PlanarPreview(*gains, *decays, columns)
    return LinearPreview(*gains, dims, bool(turn), tuple(axes), columns, _own(axes))


def _own(axes: Sequence[Axis]) -> tuple[tuple[float, float, float, float], ...]:
    """See `LinearPreview.own`."""
    own = []
    for place, axis in enumerate(axes):
        for row in (axis.position_gain, axis.velocity_gain):
            if len(row) != len(axes) or any(value for other, value in enumerate(row) if other != place):
                return ()
        gains = axis.position_gain[place], axis.velocity_gain[place]
        own.append((axis.position_decay, axis.velocity_decay, *gains))
    return tuple(own)


def _greatest(rows: Sequence[Row]) -> float:
    """Greatest length that a unit action gives: the spectral norm, exact where components act on one axis."""
    if all(sum(map(bool, column)) <= 1 for column in zip(*rows, strict=True)):
        return max(math.hypot(*row) for row in rows)
    return float(np.linalg.norm(np.array(rows), 2))


def in_numbers(preview: Preview) -> Row:
    """A linear preview in plain numbers; empty for another one.

    Returns:
        The gains of position and velocity, then for x, y and in space z: the decays of position and velocity,
        and what each of d action components adds to them.
    """
    if not isinstance(preview, LinearPreview | PlanarPreview):
        return ()
    numbers = [preview.position_gain, preview.velocity_gain]
    for axis, (place, speed) in enumerate(((0, 2), (1, 3), (4, 5))[: preview.dims]):
        of = preview if isinstance(preview, PlanarPreview) else preview.axes[axis]
        numbers += (of.position_decay, of.velocity_decay)
        numbers += [column[place] for column in preview.columns]
        numbers += [column[speed] for column in preview.columns]
    return tuple(numbers)


class LinearPreview(msgspec.Struct, frozen=True, gc=False):
    """A `Preview` whose Jacobian is the same everywhere."""

    position_gain: float
    velocity_gain: float
    dims: int
    turns: bool
    axes: tuple[Axis, ...]
    columns: Columns
    own: tuple[tuple[float, float, float, float], ...] = ()
    """Decays of position and velocity, and gains of both, of each axis, where each action component acts on
    the axis at its place alone; else empty."""

    def forecast(self, state: RobotState) -> "LinearForecast":
        """See `Preview.forecast`."""
        moved = [
            (place + axis.position_decay * speed, axis.velocity_decay * speed)
            for axis, place, speed in zip(self.axes, *self._state(state), strict=True)
        ]
        return LinearForecast(self._arranged(moved), self)

    def predict(self, state: RobotState, action: Sequence[float]) -> PredictedMotion:
        """See `Preview.predict`."""
        if not self.own:
            return self.forecast(state).at(action)[0]
        return self._arranged(
            [
                (place + reach * speed + shift * u, keep * speed + push * u)
                for (reach, keep, shift, push), place, speed, u in zip(
                    self.own, *self._state(state), action, strict=True
                )
            ]
        )

    def _state(self, state: RobotState) -> tuple[Row, Row]:
        """Where the axes are, and how fast they move."""
        if not self.turns:
            return state.position_m, state.velocity_m_s
        return (*state.position_m, state.heading_rad), (*state.velocity_m_s, state.yaw_rate_rad_s)

    def _arranged(self, moved: Sequence[tuple[float, float]]) -> PredictedMotion:
        """The motion of which ``moved`` are places and speeds, axis by axis."""
        (x, vx), (y, vy), *_ = moved
        z, vz = moved[2] if self.dims == 3 else (0.0, 0.0)
        heading, yaw_rate = moved[-1] if self.turns else (0.0, 0.0)
        return new_tuple(PredictedMotion, (x, y, vx, vy, z, vz, heading, yaw_rate))

    def pull_back(self, slope: Sequence[float]) -> Row:
        """See `Jacobian.pull_back`."""
        return pulled_back(self.columns, slope)


class LinearForecast(msgspec.Struct, frozen=True, gc=False):
    """A `Forecast` that is linear in the action."""

    drift: PredictedMotion
    preview: LinearPreview

    def at(self, action: Sequence[float]) -> tuple[PredictedMotion, LinearPreview]:
        """See `Forecast.at`."""
        motion = list(self.drift)
        for value, column in zip(action, self.preview.columns, strict=True):
            for component, gain in enumerate(column):
                motion[component] += gain * value
        return PredictedMotion(*motion), self.preview


class PlanarPreview(msgspec.Struct, frozen=True, gc=False):
    """A `Preview` of the plane with the same gains along x and y, one action component for each.

    The numbers are those of `LinearPreview`, in as few operations as Python can.
    """

    position_gain: float
    velocity_gain: float
    velocity_decay: float
    position_decay: float
    columns: Columns
    dims: int = 2

    def forecast(self, state: RobotState) -> "PlanarForecast":
        """See `Preview.forecast`."""
        (x, y), (vx, vy) = state.position_m, state.velocity_m_s
        reach, keep = self.position_decay, self.velocity_decay
        drift = (x + reach * vx, y + reach * vy, keep * vx, keep * vy, 0.0, 0.0, 0.0, 0.0)
        return PlanarForecast(new_tuple(PredictedMotion, drift), self)

    def predict(self, state: RobotState, action: Sequence[float]) -> PredictedMotion:
        """See `Preview.predict`."""
        (x, y), (vx, vy), (ux, uy) = state.position_m, state.velocity_m_s, action
        reach, keep = self.position_decay, self.velocity_decay
        shift, push = self.position_gain, self.velocity_gain
        x, vx = x + reach * vx + shift * ux, keep * vx + push * ux
        y, vy = y + reach * vy + shift * uy, keep * vy + push * uy
        return new_tuple(PredictedMotion, (x, y, vx, vy, 0.0, 0.0, 0.0, 0.0))

    def pull_back(self, slope: Sequence[float]) -> Row:
        """See `Jacobian.pull_back`."""
        _cost, d_x, d_y, d_vx, d_vy, *_others = slope
        shift, push = self.position_gain, self.velocity_gain
        return (shift * d_x + push * d_vx, shift * d_y + push * d_vy)


class PlanarForecast(msgspec.Struct, frozen=True, gc=False):
    """A `Forecast` of the plane, see `PlanarPreview`."""

    drift: PredictedMotion
    preview: PlanarPreview

    def at(self, action: Sequence[float]) -> tuple[PredictedMotion, PlanarPreview]:
        """See `Forecast.at`."""
        drift, (ax, ay), preview = self.drift, action, self.preview
        shift, push = preview.position_gain, preview.velocity_gain
        x, vx = drift[0] + shift * ax, drift[2] + push * ax
        y, vy = drift[1] + shift * ay, drift[3] + push * ay
        return new_tuple(PredictedMotion, (x, y, vx, vy, 0.0, 0.0, 0.0, 0.0)), preview
