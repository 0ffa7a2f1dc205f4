"""What a CAN robot's feedback means: its condition after the profile's rules, its pose by dead reckoning."""

import math

import msgspec

from edge_runtime.messages import RobotState
from firmware_bridge.can.codec import Decoded
from firmware_bridge.can.profile import Feedback, MotionSignals, Rule
from firmware_bridge.guard.link import Condition, Health
from firmware_bridge.kinematics.base import Base, BaseMotion, yaw_from_steering
from firmware_bridge.kinematics.frames import rotate, wrap


class PlanarPose(msgspec.Struct, frozen=True, gc=False):
    """Where the base's axle is in the team's frame."""

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0


class FeedbackRules:
    """Keeps the newest values with their times and judges them.

    Each signal that is used has an age of its own: a multiplexed message comes, whatever page is missing.
    """

    def __init__(self, feedback: Feedback) -> None:
        self._feedback = feedback
        self._values: dict[str, float] = {}
        self._longest_s = dict(feedback.stale_s)
        for signal in feedback.signals:
            self._longest_s[signal] = feedback.stale_s[signal.partition(".")[0]]
        self._times_s = dict.fromkeys(self._longest_s, -math.inf)
        self._fresh_until_s = -math.inf
        """Until then at least all of them are fresh."""
        self._ruling = frozenset(rule.signal for rule in feedback.rules)
        self._judged: Health | None = None
        """What the newest values mean while all of them are fresh; None until somebody asks."""

    def take(self, decoded: Decoded, now_s: float) -> None:
        """Remember one frame."""
        values = decoded.values
        if any(values[name] != self._values.get(name) for name in self._ruling & values.keys()):
            self._judged = None
        self._values.update(values)
        self._times_s.update(dict.fromkeys(self._times_s.keys() & values.keys(), now_s))
        self._times_s[decoded.message] = now_s

    def health(self, now_s: float) -> Health:
        """Judge: an override goes before stale feedback, that before faults, those before not being ready."""
        if now_s > self._fresh_until_s:
            self._fresh_until_s = min(self._times_s[name] + age for name, age in self._longest_s.items())
        if now_s > self._fresh_until_s:
            return self._judge(now_s)
        if self._judged is None:
            self._judged = self._judge(now_s)
        return self._judged

    def _judge(self, now_s: float) -> Health:
        if (rule := self._first(self._feedback.override)) is not None:
            return Health(
                Condition.OVERRIDE, f"the operator or an emergency stop took over ({self._said(rule)})"
            )
        for name, longest_s in self._longest_s.items():
            if now_s > self._times_s[name] + longest_s:
                return Health(Condition.FAULT, _stale(name, now_s - self._times_s[name]))
        if (rule := self._first(self._feedback.fault)) is not None:
            return Health(Condition.FAULT, f"the firmware reports a fault ({self._said(rule)})")
        warned = ", ".join(self._said(rule) for rule in self._feedback.warn if self._holds(rule))
        warning = f"the firmware warns ({warned})" if warned else ""
        for rule in self._feedback.ready:
            if not self._holds(rule):
                detail = f"the firmware does not take commands ({self._said(rule)})"
                return Health(Condition.WAITING, detail, warning)
        return Health(Condition.READY, warning=warning)

    def motion(self, signals: MotionSignals, base: Base) -> BaseMotion:
        """Return the measured motion; signals not yet received count as zero."""
        forward = self._sum(signals.forward)
        steering = self._sum(signals.steering)
        yaw = yaw_from_steering(forward, steering, base) if signals.steering else self._sum(signals.yaw)
        return BaseMotion(forward, self._sum(signals.lateral), yaw, steering)

    def _first(self, rules: tuple[Rule, ...]) -> Rule | None:
        return next((rule for rule in rules if rule.signal in self._values and self._holds(rule)), None)

    def _holds(self, rule: Rule) -> bool:
        return rule.holds(self._values[rule.signal])

    def _said(self, rule: Rule) -> str:
        return f"{rule.signal} = {self._values[rule.signal]:g}"

    def _sum(self, weights: dict[str, float]) -> float:
        return sum(weight * self._values.get(signal, 0.0) for signal, weight in weights.items())


class DeadReckoning:
    """Integrates measured motion to a pose; the reference point is what the team sees."""

    def __init__(self, robot_id: int, pose: PlanarPose, base: Base) -> None:
        self.pose = pose
        self._robot_id = robot_id
        self._ahead_m = base.reference_m
        self._stamp_s = math.nan

    def advance(self, motion: BaseMotion, now_s: float) -> RobotState:
        """Take a measurement in and return the state at it (midpoint rule)."""
        passed_s = 0.0 if math.isnan(self._stamp_s) else now_s - self._stamp_s
        self._stamp_s = now_s
        turned = motion.yaw_rad_s * passed_s
        middle = self.pose.heading_rad + turned / 2
        step_x, step_y = rotate((motion.forward_m_s * passed_s, motion.lateral_m_s * passed_s), middle)
        heading = wrap(self.pose.heading_rad + turned)
        self.pose = PlanarPose(self.pose.x_m + step_x, self.pose.y_m + step_y, heading)
        return self._state(motion)

    def _state(self, motion: BaseMotion) -> RobotState:
        pose, ahead = self.pose, self._ahead_m
        offset_x, offset_y = rotate((ahead, 0.0), pose.heading_rad)
        body_velocity = (motion.forward_m_s, motion.lateral_m_s + ahead * motion.yaw_rad_s)
        return RobotState(
            self._robot_id,
            self._stamp_s,
            (pose.x_m + offset_x, pose.y_m + offset_y),
            rotate(body_velocity, pose.heading_rad),
            pose.heading_rad,
            motion.yaw_rad_s,
        )


def _stale(name: str, age_s: float) -> str:
    return f"no {name} received yet" if math.isinf(age_s) else f"{name} is {age_s:.2f} s old"
