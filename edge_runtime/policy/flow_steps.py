"""How a flow is integrated: its sampler's steps, as numbers that every backend follows alike.

With the prior field k(tau) a of `edge_runtime.policy.weights` the velocity is v = N + k a. That field is
linear, so that it integrates exactly while N is held: over a step from x to y,

    S(t) = sqrt((1 - t)^2 + t^2 s^2),   F(t) = asinh((t (1 + s^2) - 1) / s) / sqrt(1 + s^2)
    a(y) = S(y) / S(x) a(x) + S(y) (F(y) - F(x)) N,

since S' = k S and F' = 1 / S. Sampler ``exponential`` holds N of the step's middle, extrapolated from the
step before (of second order, as the method of Adams and Bashforth), and takes shorter steps towards tau = 1,
where the field changes most. Without a prior field S = 1 and F(t) = t. Sampler ``euler`` is the paper's, of
equal steps.
"""

import math
from typing import Final, Literal, NamedTuple, TypeVar, get_args

from edge_runtime.common.arrays import Floats

SamplerName = Literal["euler", "exponential"]
SAMPLERS: Final[tuple[SamplerName, ...]] = get_args(SamplerName)

Number = TypeVar("Number", float, Floats)


class FlowStep(NamedTuple):
    """One step of a flow: components of actions a (floats, or arrays of them) move on their own."""

    tau: float
    """Flow time at its beginning."""
    prior: float
    """k, of the field that is integrated exactly."""
    keep: float
    """S(y) / S(x)."""
    gain: float
    """S(y) (F(y) - F(x)): what a velocity that is held over the step adds."""
    ahead: float
    """Share of N's last change that leads to the middle of this step."""

    def network(self, action: Number, velocity: Number) -> Number:
        """N: the velocity without the prior field."""
        return velocity - self.prior * action

    def end(self, action: Number, network: Number, before: Number, guidance: Number) -> Number:
        """The action at the step's end, from N here and at the step before, and the guidance."""
        return self.keep * action + self.gain * (network + self.ahead * (network - before) + guidance)


Schedule = tuple[FlowStep, ...]
"""T steps from tau = 0 to 1."""


def flow_steps(sampler: SamplerName, count: int, prior_std: float | None) -> Schedule:
    """The steps of a sampler.

    Args:
        sampler: by its name.
        count: T, at least 1.
        prior_std: s of the prior field; None for none.
    """
    if sampler == "euler":
        return tuple(FlowStep(k / count, 0.0, 1.0, 1.0 / count, 0.0) for k in range(count))
    times = [1.0 - (1.0 - k / count) ** 2 for k in range(count + 1)]
    return tuple(
        _exponential(times[k], times[k + 1], times[k] - times[k - 1] if k else math.inf, prior_std)
        for k in range(count)
    )


def prior_gain(tau: Number, std: float) -> Number:
    """k(tau) of the prior field of deviation ``std``."""
    return (tau * std**2 - (1.0 - tau)) / ((1.0 - tau) ** 2 + tau**2 * std**2)


def _exponential(x: float, y: float, since: float, std: float | None) -> FlowStep:
    """The step from x to y, when the one before took ``since``; infinite where there was none."""
    ahead = 0.5 * (y - x) / since
    if std is None:
        return FlowStep(x, 0.0, 1.0, y - x, ahead)
    (start, begun), (end, done) = _spread_and_path(x, std), _spread_and_path(y, std)
    return FlowStep(x, prior_gain(x, std), end / start, end * (done - begun), ahead)


def _spread_and_path(t: float, std: float) -> tuple[float, float]:
    """S(t) and F(t)."""
    square = 1.0 + std**2
    return math.hypot(1.0 - t, t * std), math.asinh((t * square - 1.0) / std) / math.sqrt(square)
