import math

import msgspec
import pytest

from firmware_bridge.can.codec import Decoded
from firmware_bridge.can.feedback import DeadReckoning, FeedbackRules, PlanarPose
from firmware_bridge.can.profile import Feedback, MotionSignals, Rule
from firmware_bridge.guard.link import Condition
from firmware_bridge.kinematics.base import Base, BaseMotion

OMNI = Base("omnidirectional")
FEEDBACK = Feedback(
    stale_s={"S": 0.5, "M": 0.1},
    motion=MotionSignals({"M.v": 0.5, "M.w": 0.5}, {"M.l": 2.0}, {"M.r": 1.0}),
    ready=(Rule("S.mode", any_of=(1,)),),
    fault=(Rule("S.error", none_of=(0,)),),
    override=(Rule("S.mode", any_of=(3, 4)),),
)


def rules(mode=1, error=0, now=10.0):
    made = FeedbackRules(FEEDBACK)
    made.take(Decoded("S", {"S.mode": mode, "S.error": error}), now)
    made.take(Decoded("M", {"M.v": 1.0, "M.w": 3.0, "M.l": 0.5, "M.r": 0.25}), now)
    return made


@pytest.mark.parametrize(
    ("mode", "error", "later", "condition", "said"),
    [
        (1, 0, 0.1, Condition.READY, ""),
        (0, 0, 0.0, Condition.WAITING, "S.mode = 0"),
        (1, 2, 0.0, Condition.FAULT, "S.error = 2"),
        (1, 0, 0.11, Condition.FAULT, "M is 0.11 s old"),
        (3, 2, 9.0, Condition.OVERRIDE, "S.mode = 3"),
        (4, 0, 0.0, Condition.OVERRIDE, "S.mode = 4"),
    ],
)
def test_conditions(mode, error, later, condition, said):
    health = rules(mode, error).health(10.0 + later)
    assert health.condition is condition
    assert said in health.detail


def test_each_look_judges_what_is_newest():
    made = rules()
    assert made.health(10.0).condition is Condition.READY
    assert made.health(10.05).condition is Condition.READY
    made.take(Decoded("S", {"S.mode": 0, "S.error": 0}), 10.05)
    assert made.health(10.05).condition is Condition.WAITING
    assert made.health(10.11).condition is Condition.FAULT
    made.take(Decoded("M", {"M.v": 0.0, "M.w": 0.0, "M.l": 0.0, "M.r": 0.0}), 10.25)
    made.take(Decoded("S", {"S.mode": 1, "S.error": 0}), 10.25)
    assert made.health(10.3).condition is Condition.READY
    assert made.health(10.36).detail == "M is 0.11 s old"


def test_before_anything_arrived():
    health = FeedbackRules(FEEDBACK).health(0.0)
    assert health.condition is Condition.FAULT
    assert health.detail == "no S received yet"


def test_each_page_of_a_multiplexed_message_has_its_own_age():
    made = FeedbackRules(FEEDBACK)
    made.take(Decoded("S", {"S.mode": 1}), 10.0)
    made.take(Decoded("M", {"M.v": 1.0, "M.w": 3.0, "M.l": 0.5, "M.r": 0.25}), 10.0)
    health = made.health(10.0)
    assert (health.condition, health.detail) == (Condition.FAULT, "no S.error received yet")
    made.take(Decoded("S", {"S.error": 0}), 10.01)
    assert made.health(10.02).condition is Condition.READY
    for time in (10.1, 10.3, 10.5, 10.6):
        made.take(Decoded("S", {"S.error": 0}), time)
        made.take(Decoded("M", {"M.v": 1.0, "M.w": 3.0, "M.l": 0.5, "M.r": 0.25}), time)
    health = made.health(10.6)
    assert (health.condition, health.detail) == (Condition.FAULT, "S.mode is 0.60 s old")


def test_an_override_of_a_page_that_is_gone_still_holds():
    made = rules(mode=3)
    made.take(Decoded("S", {"S.error": 0}), 12.0)
    assert made.health(12.0).condition is Condition.OVERRIDE


def test_motion_is_a_weighted_sum():
    assert rules().motion(FEEDBACK.motion, OMNI) == BaseMotion(2.0, 1.0, 0.25, 0.0)
    assert FeedbackRules(FEEDBACK).motion(FEEDBACK.motion, OMNI) == BaseMotion()


def test_cars_turn_by_their_steering():
    car = Base("ackermann", wheelbase_m=0.5, max_steering_rad=0.6)
    signals = msgspec.structs.replace(FEEDBACK.motion, steering={"M.r": 1.0})
    motion = rules().motion(signals, car)
    assert motion.yaw_rad_s == pytest.approx(2.0 * math.tan(0.25) / 0.5)
    assert motion.steering_rad == 0.25


def test_a_circle_closes():
    robot = DeadReckoning(1, PlanarPose(1.0, 2.0, 0.5), OMNI)
    steps = 1000
    robot.advance(BaseMotion(1.0, 0.0, 2 * math.pi), 5.0)
    for step in range(1, steps + 1):
        state = robot.advance(BaseMotion(1.0, 0.0, 2 * math.pi), 5.0 + step / steps)
    assert state.position_m == pytest.approx((1.0, 2.0), abs=1e-9)
    assert state.heading_rad == pytest.approx(0.5, abs=1e-9)
    assert state.stamp_s == 6.0


def test_a_line_in_the_teams_frame():
    robot = DeadReckoning(1, PlanarPose(0.0, 0.0, math.pi / 2), OMNI)
    robot.advance(BaseMotion(), 0.0)
    state = robot.advance(BaseMotion(1.0, 0.5), 2.0)
    assert state.position_m == pytest.approx((-1.0, 2.0))
    assert state.velocity_m_s == pytest.approx((-0.5, 1.0))
    assert state.robot_id == 1


def test_the_point_ahead_is_what_is_reported():
    robot = DeadReckoning(1, PlanarPose(), Base("differential", "lookahead", 0.2))
    state = robot.advance(BaseMotion(0.5, 0.0, 1.0), 0.0)
    assert state.position_m == pytest.approx((0.2, 0.0))
    assert state.velocity_m_s == pytest.approx((0.5, 0.2))
