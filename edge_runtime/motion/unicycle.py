"""Wheels that roll and do not slip: forward along the heading, and turning.

In each step h, forward speed s and yaw rate w follow the action first, then the robot moves along the
heading halfway through its turn:

    p <- p + s h (cos, sin)(heading + w h / 2),   heading <- heading + w h
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from edge_runtime.messages import RobotState
from edge_runtime.motion.model import Fault, Model, not_positive
from edge_runtime.motion.prediction import Columns, PredictedMotion, pulled_back

Number = Any
"""A float, or an array of them: one robot or many, by the same equations."""


class Rolling(NamedTuple):
    """Where a unicycle is and how it rolls, in m, rad, m/s and rad/s."""

    x: Number
    y: Number
    heading: Number
    speed: Number
    yaw_rate: Number


class Unicycle(Model, frozen=True, tag="unicycle"):
    """The action is (forward speed or acceleration, yaw rate or acceleration)."""

    dt_s: float
    """Of one control step."""
    forward: Literal["speed", "acceleration"] = "speed"
    """What the first component asks for."""
    turn: Literal["rate", "acceleration"] = "rate"
    """What the second component asks for."""
    gain: float = 1.0
    """What one unit of the first component is, in m/s or m/s^2."""

    @property
    def dims(self) -> Literal[2, 3]:
        """The plane."""
        return 2

    @property
    def turns(self) -> bool:
        """See `Model.turns`."""
        return True

    @property
    def action_dim(self) -> int:
        """See `Model.action_dim`."""
        return 2

    def preview(self, steps: int) -> "UnicyclePreview":
        """See `Model.preview`."""
        if steps < 1:
            raise ValueError(f"a preview looks at least one step ahead, got {steps}")
        _, (straight, _) = self.roll(Rolling(0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0), steps)
        return UnicyclePreview(straight[0], straight[2], self, steps)

    def roll(
        self,
        start: Rolling,
        action: Sequence[Number],
        steps: int,
        cos: Callable[[Number], Number] = math.cos,
        sin: Callable[[Number], Number] = math.sin,
    ) -> tuple[PredictedMotion, tuple[tuple[Number, ...], ...]]:
        """The motion after so many steps, and its derivatives; see `Columns`."""
        x, y, heading, speed, yaw_rate = start
        (forward, turn), period = action, self.dt_s
        forward = self.gain * forward
        # Derivatives: of the speed, and of the place, by forward; of yaw rate, heading and place by turn.
        d_speed = d_yaw_rate = d_heading = forward_x = forward_y = turn_x = turn_y = 0.0 * speed
        for _ in range(steps):
            if self.forward == "speed":
                speed, d_speed = forward, self.gain + 0.0 * speed
            else:
                speed, d_speed = speed + period * forward, d_speed + period * self.gain
            if self.turn == "rate":
                yaw_rate, d_yaw_rate = turn, 1.0 + 0.0 * yaw_rate
            else:
                yaw_rate, d_yaw_rate = yaw_rate + period * turn, d_yaw_rate + period
            half = 0.5 * period
            along_x, along_y = cos(heading + half * yaw_rate), sin(heading + half * yaw_rate)
            d_middle = d_heading + half * d_yaw_rate
            x, y = x + period * speed * along_x, y + period * speed * along_y
            forward_x, forward_y = (
                forward_x + period * d_speed * along_x,
                forward_y + period * d_speed * along_y,
            )
            turn_x = turn_x - period * speed * along_y * d_middle
            turn_y = turn_y + period * speed * along_x * d_middle
            heading, d_heading = heading + period * yaw_rate, d_heading + period * d_yaw_rate
        ahead_x, ahead_y = cos(heading), sin(heading)
        nothing = 0.0 * speed
        vx, vy = speed * ahead_x, speed * ahead_y
        motion = PredictedMotion(x, y, vx, vy, nothing, nothing, heading, yaw_rate)
        by_forward = (forward_x, forward_y, d_speed * ahead_x, d_speed * ahead_y)
        by_turn = (turn_x, turn_y, -vy * d_heading, vx * d_heading, nothing, nothing, d_heading, d_yaw_rate)
        return motion, (by_forward, by_turn)

    def at_period(self, period_s: float) -> "Unicycle":
        """See `Model.at_period`."""
        return replace(self, dt_s=period_s)

    def scaled(self, scale_m: float) -> "Unicycle":
        """See `Model.scaled`."""
        return replace(self, gain=self.gain * scale_m)

    def faults(self) -> Iterator[Fault]:
        """See `Model.faults`."""
        yield from not_positive("dt_s", self.dt_s)
        yield from not_positive("gain", self.gain)


class UnicyclePreview(msgspec.Struct, frozen=True, gc=False):
    """See `edge_runtime.motion.prediction.Preview`; the gains are those of going straight."""

    position_gain: float
    velocity_gain: float
    model: Unicycle
    steps: int
    dims: int = 2

    def forecast(self, state: RobotState) -> "UnicycleForecast":
        """See `Preview.forecast`."""
        (x, y), (vx, vy), heading = state.position_m, state.velocity_m_s, state.heading_rad
        speed = vx * math.cos(heading) + vy * math.sin(heading)
        start = Rolling(x, y, heading, speed, state.yaw_rate_rad_s)
        drift, _ = self.model.roll(start, (0.0, 0.0), self.steps)
        return UnicycleForecast(self.model, self.steps, start, drift)

    def predict(self, state: RobotState, action: Sequence[float]) -> PredictedMotion:
        """See `Preview.predict`."""
        return self.forecast(state).at(action)[0]


class UnicycleForecast(msgspec.Struct, frozen=True, gc=False):
    """See `edge_runtime.motion.prediction.Forecast`."""

    model: Unicycle
    steps: int
    start: Rolling
    drift: PredictedMotion

    def at(self, action: Sequence[float]) -> tuple[PredictedMotion, "UnicycleJacobian"]:
        """See `Forecast.at`."""
        motion, columns = self.model.roll(self.start, action, self.steps)
        return motion, UnicycleJacobian(columns)


class UnicycleJacobian(msgspec.Struct, frozen=True, gc=False):
    """See `edge_runtime.motion.prediction.Jacobian`."""

    columns: Columns

    def pull_back(self, slope: Sequence[float]) -> tuple[float, ...]:
        """See `Jacobian.pull_back`."""
        return pulled_back(self.columns, slope)
