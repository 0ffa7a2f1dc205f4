"""What a motion model predicts of one robot, and how that depends on the action which it holds."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from edge_runtime.messages import RobotState


class PredictedMotion(NamedTuple):
    """Predicted motion of one robot, in m, m/s, rad and rad/s; what its model does not have is zero."""

    x: float
    y: float
    vx: float
    vy: float
    z: float = 0.0
    vz: float = 0.0
    heading: float = 0.0
    """Counter-clockwise from x, not wrapped."""
    yaw_rate: float = 0.0

    def position_m(self, dims: int) -> tuple[float, ...]:
        """The position in the plane, ``dims`` 2, or in space, 3."""
        return (self.x, self.y) if dims == 2 else (self.x, self.y, self.z)

    def velocity_m_s(self, dims: int) -> tuple[float, ...]:
        """The velocity, of as many components."""
        return (self.vx, self.vy) if dims == 2 else (self.vx, self.vy, self.vz)


Columns = tuple[tuple[float, ...], ...]
"""A Jacobian: for each of d action components, what it does to the components of a `PredictedMotion`, in
their order; the last ones are left out where a model does not have them."""


class Jacobian(Protocol):
    """How a predicted motion depends on the action, at one action."""

    @property
    def columns(self) -> Columns:
        """Itself."""
        ...

    def pull_back(self, slope: Sequence[float]) -> tuple[float, ...]:
        """A cost's gradient (d,) with respect to the action.

        Args:
            slope: the cost, and its derivatives over the first 4 to 8 components of the motion.
        """
        ...


def pulled_back(columns: Columns, slope: Sequence[float]) -> tuple[float, ...]:
    """See `Jacobian.pull_back`."""
    _cost, d_x, d_y, d_vx, d_vy, *others = slope
    over, gradient = (d_x, d_y, d_vx, d_vy, *others), []
    for column in columns:
        along = 0.0
        for gain, derivative in zip(column, over, strict=False):
            along += gain * derivative
        gradient.append(along)
    return tuple(gradient)


class Forecast(Protocol):
    """One robot's motion at a time, as a function of the action that it holds until then."""

    @property
    def drift(self) -> PredictedMotion:
        """The motion under a zero action."""
        ...

    def at(self, action: Sequence[float]) -> tuple[PredictedMotion, Jacobian]:
        """The motion under an action (d,), and its Jacobian there."""
        ...


class Preview(Protocol):
    """A model's look so many steps ahead, made ready once."""

    @property
    def dims(self) -> int:
        """2 in the plane, 3 in space."""
        ...

    @property
    def position_gain(self) -> float:
        """Farthest that a unit action moves the predicted position, in m: costs are stated by it."""
        ...

    @property
    def velocity_gain(self) -> float:
        """Most that a unit action changes the predicted velocity by, in m/s."""
        ...

    def forecast(self, state: RobotState) -> Forecast:
        """The robot's motion from a state."""
        ...

    def predict(self, state: RobotState, action: Sequence[float]) -> PredictedMotion:
        """The robot's motion from a state under an action; ``forecast(state).at(action)[0]``."""
        ...
