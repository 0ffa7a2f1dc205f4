"""Sampling an action from the guided flow: T Euler steps of eqs. 10 to 12 with the projections of IV-C.

At flow time tau = k / T, with velocity v and its Jacobian V from one pass through the network:

    a_hat = a + (1 - tau) v                      terminal estimate
    g_m   = -(I + (1 - tau) V)^T grad J_m(a_hat)   eq. 11
    a    <- a + (v + combine(eta lambda, g, v)) / T

``guided_action`` serves one planar robot and is the control loop's; ``guided_actions`` serves B robots of
an evaluation. They compute the same, and a test holds them together.
"""

import math
import time
from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from edge_runtime.dynamics import Dynamics
from edge_runtime.kernel import MAX_TERMS, CompiledPolicy, encodable, encode
from edge_runtime.messages import TeamState, Vector2
from edge_runtime.objectives import Objective
from edge_runtime.policy import VelocityField
from edge_runtime.projection import BATCH, PLANAR, Mode, weighted_sum
from edge_runtime.scene import Floats, Motion, OutlookBatch, TeamBatch, look_ahead, look_ahead_batch


class GuidanceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How strongly objectives steer, and how their conflicts are resolved.

    Raises:
        ValueError: if the scale or the start noise is negative or not finite.
    """

    mode: Mode = "cone"
    scale: float = 10.0
    """eta of eq. 10."""
    start_noise: float = 0.0
    """Deviation of the Gaussian that the flow starts from; 0 starts at the mean, 1 is the paper's prior."""

    def __post_init__(self) -> None:
        for field in ("scale", "start_noise"):
            value = getattr(self, field)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"`{field}` must be finite and not negative, got {value}")


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
        self.mode = settings.mode
        self.native = len(active) <= MAX_TERMS and all(map(encodable, active))
        """Whether the compiled kernel can run the whole flow."""
        self.combine = PLANAR[settings.mode]
        self.combine_batch = BATCH[settings.mode]


class GuidedAction(msgspec.Struct, frozen=True, gc=False):
    """One sampled action and what happened on the way."""

    action: Vector2
    steps: int
    """Euler steps completed; fewer than T if the deadline came first."""
    costs: tuple[float, ...] = ()
    """Each active objective's cost at the last terminal estimate."""
    projections: int = 0
    """Steps in which the projection changed the guidance."""
    fault: str = ""
    """Why the action must not be used: a non-finite observation, gradient or velocity. Else empty."""


def guided_action(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamState,
    guide: Guide,
    start: Vector2 = (0.0, 0.0),
    deadline_s: float = math.inf,
) -> GuidedAction:
    """Sample one planar robot's action.

    Anytime: after every step a + (1 - tau) v + guidance / T is a usable action, and after the last one it
    is the sample itself. When another step would end after ``deadline_s``, judged by the longest step so
    far, the newest one is returned.

    Args:
        policy: a velocity field of batch 1 and two action components.
        observation: (1, O).
        team: the robot's own state and its teammates'.
        guide: the objectives.
        start: the flow's start, a sample of the prior.
        deadline_s: `time.monotonic` time by which the action is needed.
    """
    if not math.isfinite(observation.sum()):
        return _refused(0, "the observation is not finite")
    policy.observe(observation)
    if guide.native and isinstance(policy, CompiledPolicy):
        return _guided_action_compiled(policy, team, guide, start, deadline_s)
    bound = [
        (objective.evaluate, look_ahead(team, preview), preview.position_gain, preview.velocity_gain, factor)
        for objective, preview, factor in zip(guide.objectives, guide.previews, guide.factors, strict=True)
    ]
    (ax, ay), total, projections = start, policy.euler_steps, 0
    costs: list[float] = []
    now, longest = time.monotonic(), 0.0
    for k in range(total):
        ((vx, vy),), ((jxx, jxy),), ((jyx, jyy),) = policy.step(k, ((ax, ay),)).tolist()
        left = 1.0 - k / total
        hx, hy = ax + left * vx, ay + left * vy
        gradients, factors = [], []
        costs.clear()
        for evaluate, outlook, shift, push, factor in bound:
            x, y, sx, sy = outlook.drift
            motion = Motion(x + shift * hx, y + shift * hy, sx + push * hx, sy + push * hy)
            cost, d_x, d_y, d_vx, d_vy = evaluate(motion, outlook)
            gx, gy = shift * d_x + push * d_vx, shift * d_y + push * d_vy
            if not math.isfinite(gx + gy):
                return _refused(k, f"the gradient of {guide.objectives[len(costs)].name} is not finite")
            costs.append(cost)
            if gx or gy:
                gradients.append((-gx - left * (jxx * gx + jxy * gy), -gy - left * (jyx * gx + jyy * gy)))
                factors.append(factor)
        ex = ey = 0.0
        if gradients:
            ex, ey = guide.combine(gradients, factors, (vx, vy))
            projections += (ex, ey) != weighted_sum(gradients, factors, (vx, vy))
        ax += (vx + ex) / total
        ay += (vy + ey) / total
        before, now = now, time.monotonic()
        longest = max(longest, now - before)
        if now + longest > deadline_s:
            ax, ay = hx + ex / total, hy + ey / total
            break
    if not math.isfinite(ax + ay):
        return _refused(k + 1, "the policy's velocity is not finite")
    return GuidedAction((ax, ay), k + 1, tuple(costs), projections)


def _guided_action_compiled(
    policy: CompiledPolicy, team: TeamState, guide: Guide, start: Vector2, deadline_s: float
) -> GuidedAction:
    """The loop of `guided_action` in the compiled kernel; the observation is set already."""
    terms = [
        encode(objective, look_ahead(team, preview), factor)
        for objective, preview, factor in zip(guide.objectives, guide.previews, guide.factors, strict=True)
    ]
    sample = policy.sample(guide.mode, terms, start, deadline_s - time.monotonic())
    if sample.fault >= 0:
        return _refused(sample.steps, f"the gradient of {guide.objectives[sample.fault].name} is not finite")
    if not math.isfinite(sum(sample.action)):
        return _refused(sample.steps, "the policy's velocity is not finite")
    return GuidedAction(sample.action, sample.steps, sample.costs, sample.projections)


def _refused(steps: int, fault: str) -> GuidedAction:
    return GuidedAction((0.0, 0.0), steps, fault=fault)


def guided_actions(
    policy: VelocityField,
    observation: npt.NDArray[np.float32],
    team: TeamBatch,
    guide: Guide,
    start: Floats,
) -> Floats:
    """Sample the actions of B robots: observation (B, O), start (B, d) -> (B, d).

    The objectives act on the first two action components. There is no deadline and no check for faults:
    a non-finite input leaves its own row non-finite.
    """
    policy.observe(observation)
    outlooks = [look_ahead_batch(team, preview) for preview in guide.previews]
    action, total = np.array(start, np.float64), policy.euler_steps
    factors = np.array(guide.factors)
    for k in range(total):
        result = policy.step(k, action).astype(np.float64)
        velocity, tangents, left = result[0], result[1:], 1.0 - k / total
        guidance = np.zeros_like(action)
        if outlooks:
            estimate = action + left * velocity
            slopes = [
                _action_slope(objective, outlook, estimate)
                for objective, outlook in zip(guide.objectives, outlooks, strict=True)
            ]
            gradients = np.stack(slopes)
            gradients = -(gradients + left * np.einsum("jbi,mbi->mbj", tangents, gradients))
            guidance = guide.combine_batch(gradients, factors, velocity)
        action += (velocity + guidance) / total
    return action


def _action_slope(objective: Objective, outlook: OutlookBatch, estimate: Floats) -> Floats:
    """dJ/da_hat (B, d) through the dynamics preview."""
    shift, push = outlook.preview.position_gain, outlook.preview.velocity_gain
    planar = estimate[:, :2]
    slope = objective.evaluate_batch(
        outlook.drift_position_m + shift * planar, outlook.drift_velocity_m_s + push * planar, outlook
    )
    gradient = np.zeros_like(estimate)
    gradient[:, :2] = shift * slope.d_position + push * slope.d_velocity
    return gradient
