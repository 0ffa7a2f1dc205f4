"""The link between inbox and client, on a client in memory and a clock that the test turns."""

import math

import msgspec
import pytest
from ros_fakes import COMMAND, ODOMETRY, PROFILE, STOP, TWIST, WHOLE, FakeClient

import firmware_bridge.ros.link as link_module
from edge_runtime.errors import BridgeError, ConfigError
from firmware_bridge.guard.link import Condition, Setpoint, SetpointLimits
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.kinematics.base import BaseMotion, turning
from firmware_bridge.ros.client import Graph, Pressed, Sight, Taken, Topic, Trouble
from firmware_bridge.ros.inbox import MOST, Inbox
from firmware_bridge.ros.link import OPENING_S, RosLink, RosOptions, make_link
from firmware_bridge.ros.odometry import Odometer, Odometry, Origin
from firmware_bridge.ros.profile import load_profile, profile_path
from firmware_bridge.ros.ros1 import Ros1Client
from firmware_bridge.ros.ros2 import Ros2Client


class Rig:
    def __init__(self, monkeypatch, profile=PROFILE) -> None:
        self.now, self.x = 50.0, 0.0
        self.inbox = Inbox()
        self.client = FakeClient(self.inbox)
        odometer = Odometer(0, profile, "/a200_0000", Origin())
        self.link = RosLink(profile, self.client, self.inbox, odometer)
        monkeypatch.setattr(link_module.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(link_module.time, "sleep", self.pass_)
        monkeypatch.setattr(link_module.select, "select", lambda _r, _w, _x, wait_s: self.pass_(wait_s))

    def pass_(self, seconds):
        self.now += min(seconds, 0.1)

    def odometry(self, **changes):
        fields = {"x_m": self.x, "y_m": 0.0, "heading_rad": 0.0, "forward_m_s": 0.0, "lateral_m_s": 0.0}
        odometry = Odometry(**fields, yaw_rad_s=0.0, stamp_s=0.0, arrival_s=self.now, frame="base_link")
        return msgspec.structs.replace(odometry, **changes)

    def hear(self, *items):
        for item in items:
            self.inbox.put(item)
        self.link.receive(self.now)

    def open(self, *items):
        self.client.arriving = [self.odometry(), Sight(1), Pressed(False), *items]
        self.link.open()
        return self

    def enable(self):
        self.play(self.link.enable_sequence())
        return self

    def play(self, steps):
        pauses = []
        for pause in steps:
            pauses.append(pause)
            self.now += pause
            self.hear(self.odometry())
        return pauses

    def condition(self):
        health = self.link.health(self.now)
        return health.condition, health.detail


@pytest.fixture
def rig(monkeypatch):
    return Rig(monkeypatch)


def test_a_whole_robot_is_opened_enabled_driven_and_stopped(rig):
    rig.open()
    assert rig.client.log == ["connect", PROFILE.timeout_parameter, "advertise", "listen"]
    assert (rig.link.firmware_timeout_s, rig.link.recoveries, rig.link.dropped()) == (0.5, 3, 0)
    assert rig.condition() == (Condition.WAITING, "not enabled by this guard: pass --arm")
    rig.enable()
    assert rig.condition() == (Condition.READY, "")
    rig.link.send(Setpoint(0, rig.now, (0.0, 0.0), (0.5, 0.2)), rig.now)
    rig.link.keepalive(True, rig.now)
    assert rig.play(rig.link.stop_sequence()) == [0.02, 0.02, 0.02]
    motions = [motion for motion, _ in rig.client.published]
    rest = BaseMotion()
    assert motions == [rest, BaseMotion(0.5, 0.0, 0.2 / 0.4), rest, rest, rest]
    assert rig.condition()[0] is Condition.WAITING
    rig.link.close()
    assert rig.client.log[-1] == "close"


def test_the_librarys_threads_never_go_before_everything_else(rig, monkeypatch):
    monkeypatch.setattr(link_module, "leave_realtime", lambda: rig.client.log.append("ordinary"))
    rig.open()
    assert rig.client.log[:2] == ["ordinary", "connect"]


def test_nothing_is_commanded_before_there_is_odometry(rig):
    with pytest.raises(BridgeError, match=f"no odometry on {ODOMETRY}"):
        rig.link.send(Setpoint(0, 0.0, (0.0, 0.0), (0.5, 0.0)), rig.now)


@pytest.mark.parametrize(
    ("item", "detail"),
    [
        (Pressed(True), f"the emergency stop is pressed ({STOP})"),
        (Taken("/joy"), "an operator commands the robot on /joy"),
        (Sight(1, ("/rival",)), f"/rival publishes on {COMMAND} too"),
    ],
)
def test_whoever_takes_the_robot_keeps_it(rig, item, detail):
    rig.open().enable()
    rig.hear(item)
    assert rig.condition() == (Condition.OVERRIDE, detail)
    before = len(rig.client.published)
    assert rig.play(rig.link.stop_sequence()) == []
    assert len(rig.client.published) == before


@pytest.mark.parametrize(
    ("item", "detail"),
    [(Sight(0), f"nobody listens on {COMMAND}"), (Trouble("the master is gone"), "the master is gone")],
)
def test_a_robot_that_does_not_hear_is_lost(rig, item, detail):
    rig.open().enable()
    rig.hear(item)
    assert rig.condition() == (Condition.LOST, detail)


def test_an_override_goes_before_loss_and_loss_before_odometry(rig):
    rig.open().enable()
    rig.now += 1.0
    assert rig.condition() == (Condition.FAULT, "odometry is 1.00 s old")
    rig.hear(Sight(0))
    assert rig.condition()[0] is Condition.LOST
    rig.hear(Pressed(True))
    assert rig.condition()[0] is Condition.OVERRIDE
    rig.hear(Pressed(False), Sight(1), rig.odometry())
    assert rig.condition() == (Condition.READY, "")


def test_two_that_tell_the_odometry_are_a_fault(rig):
    rig.open().enable()
    rig.hear(Sight(1, (), 2), rig.odometry())
    assert rig.condition() == (
        Condition.FAULT,
        f"2 nodes publish {ODOMETRY}: one robot has one odometry",
    )


def test_an_emergency_stop_that_falls_silent_stops_the_robot_until_it_speaks(rig):
    rig.open().enable()
    longest_s = PROFILE.emergency_stop_silent_s
    for passed_s in (0.9 * longest_s, 0.9 * longest_s):
        rig.now += passed_s
        rig.hear(rig.odometry(), Pressed(False))
        assert rig.condition() == (Condition.READY, "")
    rig.now += longest_s
    rig.hear(rig.odometry())
    assert rig.condition()[0] is Condition.READY
    rig.now += 0.1
    assert rig.condition() == (Condition.FAULT, f"the emergency stop has been silent for 3.1 s ({STOP})")
    steps = rig.link.enable_sequence()
    next(steps), next(steps)
    rig.hear(Pressed(False))
    assert list(steps) == []
    assert rig.condition() == (Condition.READY, "")
    rig.hear(Pressed(True))
    rig.now += 10.0
    assert rig.condition()[0] is Condition.OVERRIDE  # its last word counts, however old


def test_one_that_was_heard_at_the_start_alone_falls_silent_too(rig):
    rig.client.graphs = [Graph(changed(STOP, publishers=()))]  # who told it is gone
    rig.open()
    rig.now += 4.0
    rig.hear(rig.odometry())
    assert rig.condition()[1].startswith("the emergency stop has been silent for 4")


def test_nobody_publishes_the_stop_and_then_somebody_falls_silent(rig):
    rig.client.graphs = [Graph(changed(STOP, publishers=()))]
    rig.client.arriving = [rig.odometry(), Sight(1)]
    rig.link.open()
    rig.enable()
    rig.now += 100.0
    rig.hear(rig.odometry())
    assert rig.condition()[0] is Condition.READY
    rig.hear(Pressed(False))
    rig.now += 4.0
    rig.hear(rig.odometry())
    assert rig.condition()[0] is Condition.FAULT


def test_a_stop_that_is_told_when_it_changes_may_be_silent(monkeypatch):
    rig = Rig(monkeypatch, msgspec.structs.replace(PROFILE, emergency_stop_silent_s=None))
    rig.open().enable()
    rig.now += 1000.0
    rig.hear(rig.odometry())
    assert rig.condition() == (Condition.READY, "")


def test_odometry_that_stays_away_ends_the_enabling(rig):
    rig.open()
    rig.now += 0.5
    steps = rig.link.enable_sequence()
    with pytest.raises(BridgeError, match=r"not enabled within 2 s: odometry is 2\.\d\d s old"):
        for pause in steps:
            rig.now += pause


def test_odometry_that_comes_back_lets_the_enabling_go_on(rig):
    rig.open()
    rig.now += 0.5
    assert rig.play(rig.link.enable_sequence()) == [0.02]
    rig.now += 0.5
    steps = rig.link.enable_sequence()
    assert [next(steps), next(steps)] == [0.02, 0.02]
    rig.hear(rig.odometry())
    assert list(steps) == []


def test_a_flood_is_an_error(rig):
    rig.open()
    for _ in range(2 * MOST):
        rig.inbox.put(Sight(1))
    with pytest.raises(BridgeError, match="floods"):
        rig.link.receive(rig.now)


def test_the_robot_may_be_discovered_late(rig):
    rig.client.graphs = [Graph(), Graph({COMMAND: WHOLE[COMMAND]}), Graph(WHOLE)]
    rig.open()
    assert rig.client.log[-1] == "listen"


def test_others_may_be_discovered_after_the_robot(rig):
    rig.client.settling_s = 2.0
    rig.client.graphs = [*[Graph(WHOLE)] * 5, Graph(WHOLE, (FakeClient.name,))]
    with pytest.raises(BridgeError, match="is there already"):
        rig.open()
    assert "advertise" not in rig.client.log


def test_and_it_is_driven_once_nobody_was(rig):
    rig.client.settling_s = 2.0
    rig.client.graphs = [Graph(WHOLE), Graph(), Graph(WHOLE)]
    rig.open()
    assert 52.15 < rig.now < 52.6


def test_a_robot_that_is_found_late_may_still_turn_out_to_be_somebody_elses(rig):
    rig.client.settling_s = 2.0
    rig.client.graphs = [*[Graph()] * 95, *[Graph(WHOLE)] * 15, Graph(WHOLE, (FakeClient.name,))]
    with pytest.raises(BridgeError, match="is there already"):
        rig.open()


CHECK = "check --ros-namespace and --ros-profile"
OTHER_PROFILE = "take the profile of this robot's software, or set `message` in a copy"
JOYSTICK = PROFILE.operators[0]
EIGHT = "/0, /1, /2, /3, /4, /5, /6, /7"
IN_TIME = "within 10 s (domain 7)"


def changed(name, **changes):
    return {**WHOLE, name: msgspec.structs.replace(WHOLE[name], **changes)}


@pytest.mark.parametrize(
    ("graph", "error", "line"),
    [
        (
            Graph(WHOLE, (FakeClient.name,)),
            BridgeError,
            f"node {FakeClient.name} is there already: another edge-run drives this robot; "
            "one that was killed is forgotten within half a minute",
        ),
        (
            Graph(changed(COMMAND, types=("a/A", TWIST, "b/B"))),
            ConfigError,
            f"{COMMAND} carries a/A, b/B here, --ros-profile says {TWIST}: {OTHER_PROFILE}",
        ),
        (
            Graph(changed(STOP, types=("std_msgs/Empty",))),
            ConfigError,
            f"{STOP} carries std_msgs/Empty here, --ros-profile says std_msgs/Bool: {OTHER_PROFILE}",
        ),
        (
            Graph({**WHOLE, JOYSTICK: Topic(("geometry_msgs/Twist",))}),
            ConfigError,
            f"{JOYSTICK} carries geometry_msgs/Twist here, --ros-profile says {TWIST}: {OTHER_PROFILE}",
        ),
        (
            Graph(changed(COMMAND, publishers=("/move_base",))),
            BridgeError,
            f"/move_base publishes on {COMMAND} too: end it, or it will fight this guard",
        ),
        (
            Graph(changed(ODOMETRY, publishers=("/one", "/two"))),
            BridgeError,
            f"{ODOMETRY} comes from /one, /two: one robot has one odometry",
        ),
        (
            Graph(changed(COMMAND, subscribers=())),
            BridgeError,
            f"nobody listens on {COMMAND} (domain 7), only {STOP}, {ODOMETRY}: {CHECK}",
        ),
        (
            Graph(changed(ODOMETRY, publishers=())),
            BridgeError,
            f"nobody publishes {ODOMETRY} (domain 7), only {COMMAND}, {STOP}: {CHECK}",
        ),
        (
            Graph({"/a200_0001/cmd_vel": WHOLE[COMMAND], "/rosout": Topic()}),
            BridgeError,
            f"nobody listens on {COMMAND} (domain 7), but there are /a200_0001/cmd_vel: {CHECK}",
        ),
        (
            Graph({"/rosout": Topic((), ("/rosout",))}),
            BridgeError,
            f"nobody listens on {COMMAND} (domain 7), only /rosout: {CHECK}",
        ),
        (
            Graph({f"/{n}": Topic((), ("/x",)) for n in range(8)}),
            BridgeError,
            f"nobody listens on {COMMAND} (domain 7), only {EIGHT}: {CHECK}",
        ),
        (
            Graph({f"/{n}": Topic((), ("/x",)) for n in range(9)}),
            BridgeError,
            f"nobody listens on {COMMAND} (domain 7), only {EIGHT} and 1 more: {CHECK}",
        ),
        (
            Graph(),
            BridgeError,
            f"nobody listens on {COMMAND}, and nobody else is there (domain 7): "
            "start the robot's ROS, check network and domain",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(rig, graph, error, line):
    rig.client.graphs = [graph]
    with pytest.raises(error) as caught:
        rig.open()
    assert str(caught.value) == line
    assert "advertise" not in rig.client.log


@pytest.mark.parametrize(
    ("arriving", "line"),
    [
        ([Sight(1)], f"no odometry yet on {ODOMETRY} {IN_TIME}"),
        ([Sight(1), "nan"], f"odometry is not finite on {ODOMETRY} {IN_TIME}"),
        (
            ["odometry", Sight(0)],
            f"no subscriber of {COMMAND} takes our messages: its type or QoS differs, {IN_TIME}",
        ),
        (
            ["odometry"],
            f"no subscriber of {COMMAND} takes our messages: its type or QoS differs, {IN_TIME}",
        ),
        (["odometry", Sight(1), Pressed(True)], f"the emergency stop is pressed ({STOP})"),
        (["odometry", Sight(1), Sight(1, ("/late",))], f"/late publishes on {COMMAND} too"),
        (["odometry", Sight(1), Trouble("gone")], "gone"),
    ],
)
def test_a_robot_that_cannot_be_driven_is_not_opened(rig, arriving, line):
    known = {"odometry": rig.odometry(), "nan": rig.odometry(x_m=math.nan)}
    rig.client.arriving = [known.get(item, item) if isinstance(item, str) else item for item in arriving]
    with pytest.raises(BridgeError) as caught:
        rig.link.open()
    assert str(caught.value) == line
    assert rig.now <= 50.0 + OPENING_S + 2.0


def test_where_nobody_publishes_the_stop_nobody_waits_for_it(rig):
    rig.client.graphs = [Graph(changed(STOP, publishers=()))]
    rig.client.arriving = [rig.odometry(), Sight(1)]
    rig.link.open()
    assert (rig.link.emergency_stop.pressed, rig.now) == (None, 50.1)


def test_where_somebody_does_its_word_is_waited_for_a_while(rig):
    rig.client.arriving = [rig.odometry(), Sight(1)]
    rig.link.open()
    assert rig.link.emergency_stop.pressed is None
    assert 50.0 + PROFILE.emergency_stop_silent_s < rig.now < 54.0
    with pytest.raises(
        BridgeError, match=r"not enabled within 2 s: the emergency stop has been silent for 5"
    ):
        rig.enable()


def test_a_stop_that_is_told_when_it_changes_is_waited_for_a_second(monkeypatch):
    rig = Rig(monkeypatch, msgspec.structs.replace(PROFILE, emergency_stop_silent_s=None))
    rig.client.arriving = [rig.odometry(), Sight(1)]
    rig.link.open()
    assert 51.0 <= rig.now < 51.3


def test_a_profile_without_parameter_or_stop_asks_for_neither(monkeypatch):
    profile = load_profile(profile_path("limo_ros2")).under("")
    rig = Rig(monkeypatch, profile)
    topics = {"/cmd_vel": Topic(("geometry_msgs/Twist",), (), ("/limo",)), "/odom": WHOLE[ODOMETRY]}
    rig.client.graphs = [Graph(topics)]
    rig.open()
    assert rig.client.log == ["connect", "advertise", "listen"]
    assert rig.link.firmware_timeout_s is None
    assert (
        Rig(monkeypatch, msgspec.structs.replace(profile, firmware_timeout_s=0.4)).link.firmware_timeout_s
        == 0.4
    )


def test_commands_carry_the_robots_time(rig):
    rig.open()
    rig.hear(rig.odometry(stamp_s=1000.0))
    rig.link.send(Setpoint(0, rig.now, (0.0, 0.0), (0.0, 0.0)), rig.now + 0.01)
    assert rig.client.published[-1][1] == pytest.approx(1000.01)
    rig.now += 0.02
    next(rig.link.stop_sequence())
    assert rig.client.published[-1][1] == pytest.approx(1000.02)


def test_what_is_odd_about_its_clock_is_told_while_it_waits_and_drives(rig):
    rig.open()
    assert rig.link.health(rig.now).warning == ""
    rig.hear(rig.odometry(stamp_s=1000.0))
    waiting = rig.link.health(rig.now)
    rig.play(rig.link.enable_sequence())
    ready = rig.link.health(rig.now)
    assert (waiting.condition, ready.condition) == (Condition.WAITING, Condition.READY)
    assert waiting.warning == ready.warning
    assert "commands carry its time" in ready.warning


@pytest.mark.parametrize(("ros", "client"), [(1, Ros1Client), (2, Ros2Client)])
def test_the_specification_names_client_profile_and_namespace(ros, client):
    options = RosOptions(ros, str(profile_path("generic")), "/a200_0000", Origin(1.0, 2.0, 3.0), ("/ros",))
    link = made(options)
    assert isinstance(link._client, client)
    assert link._client.name == {1: "/cfpg_edge_4", 2: "/a200_0000/cfpg_edge_4"}[ros]
    assert (link._client._folders, link._profile.command) == (("/ros",), "/a200_0000/cmd_vel")
    assert link._client._profile is link._profile
    for item in (Odometry(*[0.0] * 7, 1.0, "a200_0001/base_link"), Sight(1)):  # as its threads do
        link._client._put(item)
    link.receive(1.0)
    ahead_m, state = link._profile.base.lookahead_m, link.state()
    assert (state.robot_id, state.heading_rad) == (4, 3.0)
    there = 1.0 + ahead_m * math.cos(3.0), 2.0 + ahead_m * math.sin(3.0)
    assert state.position_m == pytest.approx(there)
    assert link.health(1.0).detail == "odometry is of 'a200_0001/base_link', not of /a200_0000"
    link._inbox.close()


def test_folders_are_the_profiles_where_none_are_named():
    link = made(RosOptions(1, str(profile_path("husky_noetic"))))
    assert link._client._folders == load_profile(profile_path("husky_noetic")).python_path
    assert link._profile.base.sideways == "lookahead"
    link._inbox.close()


def made(options):
    raw = msgspec.Raw(msgspec.json.encode(options))
    limits = SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0))
    return make_link(GuardSpec(f"ros{options.ros}", 4, 0.1, limits, raw))


def test_a_policy_that_turns_its_robot_has_it_turned(monkeypatch):
    rig = Rig(monkeypatch, msgspec.structs.replace(PROFILE, base=turning(PROFILE.base)))
    rig.open()
    rig.link.send(Setpoint(0, rig.now, (0.0, 0.0), (0.5, 0.0), 0.3), rig.now)
    assert rig.client.published[-1][0] == BaseMotion(0.5, 0.0, 0.3)


def test_a_policy_that_turns_its_robot_steers_no_point_ahead():
    link = made(RosOptions(1, str(profile_path("husky_noetic")), turns=True))
    assert link._profile.base.sideways == "turn"
    link._inbox.close()
