"""The flags of ``--bridge can`` and what they start; then two robots that this project did not write."""

import argparse
import asyncio
import contextlib
import itertools
import os
import pty
import sys
import threading
import time
import tty

import msgspec
import pytest
from can_peers import multicast_address, patient_profile, patient_spec
from waiting import HANG_S, until

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command
from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointAcceleration, PointForce, Unicycle
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.policy.manifest import BUNDLE_FORMAT, ActionField, Manifest
from firmware_bridge.can.bridge import add_arguments, make_spec, open_bridge, options_from
from firmware_bridge.can.feedback import PlanarPose
from firmware_bridge.can.frame import Frame
from firmware_bridge.can.limo import FrameReader, frame_bytes
from firmware_bridge.can.link import CanOptions, make_link
from firmware_bridge.can.profile import PROFILES, load_profile
from firmware_bridge.guard.guarded_bridge import GuardedBridge
from firmware_bridge.guard.link import Setpoint, SetpointLimits

ACTION = (ActionField("x", "N", -1.0, 1.0), ActionField("y", "N", -2.0, 0.5))
MANIFEST = Manifest(
    BUNDLE_FORMAT,
    "m",
    "numpy",
    (),
    ACTION,
    20.0,
    10,
    None,
    PointForce(1.0, 0.25, 0.1),
    Body(0.1, 0, 0.0),
    None,
    {},
)


def mission():
    fleet = load_fleet(DEFAULT_FLEET)
    return Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, 50.0)


def parsed(*flags):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return options_from(parser.parse_args(["--bus", "can0", "--profile", "agilex_v2", *flags]))


def test_a_unicycle_policy_steers_a_differential_base_by_its_yaw_rate():
    action = (ActionField("v", "m/s", 0.0, 0.6), ActionField("omega", "rad/s", -2.5, 2.5))
    manifest = msgspec.structs.replace(MANIFEST, motion=Unicycle(0.1), action=action)
    spec = make_spec(2, manifest, parsed(), 20.0)
    assert msgspec.json.decode(spec.options, type=CanOptions).turns
    limits = spec.limits
    assert (limits.low, limits.high, limits.dims) == ((0.0, -2.5), (0.6, 2.5), 2)
    assert 0.0 < limits.yaw_rate_rad_s <= 20.0
    link = make_link(spec)
    motion = link._motion(Setpoint(0, 0.0, (0.5, 1.0), (0.5, 0.02), 1.0))
    assert (motion.forward_m_s, motion.lateral_m_s) == (pytest.approx(0.5, abs=1e-3), 0.0)
    assert motion.yaw_rad_s == 1.0


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (PointAcceleration(0.1, angular=True), "the differential base of .*agilex_v2.toml cannot: it takes"),
        (
            PointAcceleration(0.1, dims=3),
            "the differential base of .*agilex_v2.toml moves in the plane alone",
        ),
    ],
)
def test_what_a_base_cannot_follow_is_refused_at_the_start(motion, said):
    with pytest.raises(ConfigError, match=said):
        make_spec(2, msgspec.structs.replace(MANIFEST, motion=motion), parsed(), 20.0)


def specification(*flags, rate_hz=20.0):
    return make_spec(2, MANIFEST, parsed(*flags), rate_hz)


def test_flags_become_a_specification():
    spec = specification("--arm", "--pose", "1", "-2", "0.5", "--max-speed", "0.8", "--guard-deadline", "0.2")
    assert (spec.link, spec.robot_id, spec.arm, spec.deadline_s) == ("can", 2, True, 0.2)
    assert spec.limits == SetpointLimits(0.8, (-1.0, -2.0), (1.0, 0.5))
    options = msgspec.json.decode(spec.options, type=CanOptions)
    assert options.bus == "can0"
    assert options.profile.endswith("agilex_v2.toml")
    assert options.pose == PlanarPose(1.0, -2.0, 0.5)


def test_defaults_are_careful():
    spec = specification()
    assert not spec.arm
    assert not spec.allow_unsafe_firmware_timeout
    assert spec.deadline_s == 0.1
    assert specification(rate_hz=50.0).deadline_s == pytest.approx(0.06)
    assert spec.limits.speed_m_s == 1.5
    assert specification("--allow-unsafe-firmware-timeout").allow_unsafe_firmware_timeout


@pytest.mark.parametrize(
    ("flags", "rate_hz", "said"),
    [
        (("--max-speed", "1.6"), 20.0, "--max-speed 1.6: .* at most 1.5 m/s"),
        (("--max-speed", "0"), 20.0, "--max-speed 0"),
        (("--max-speed", "nan"), 20.0, "--max-speed nan"),
        (("--guard-deadline", "0.05"), 20.0, "--guard-deadline 0.05 s does not fit"),
        (("--guard-deadline", "1.1"), 20.0, "--guard-deadline 1.1 s does not fit"),
        (("--guard-deadline", "nan"), 20.0, "--guard-deadline nan s does not fit"),
        ((), 10.0, "--guard-deadline 0.1 s does not fit a control period of 0.1 s"),
        (("--guard-deadline", "1"), 2.0, "2 Hz is too slow: this firmware stops after 0.5 s"),
        (("--profile", "scout"), 20.0, "--profile scout: no such profile"),
        (("--bus", "can0?nosuch=1"), 20.0, "--bus can0.nosuch=1: socketcan knows no 'nosuch'"),
        (("--bus", ""), 20.0, "--bus : expected can0"),
    ],
)
def test_each_mistake_is_told_before_anything_starts(flags, rate_hz, said):
    with pytest.raises(ConfigError, match=said):
        specification(*flags, rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("profile", "what"), [("vesc", "wheel radius, track, pole pairs"), ("odrive_cansimple", "wheel radius")]
)
def test_what_no_message_tells_must_be_confirmed_before_it_drives(tmp_path, profile, what):
    (tmp_path / f"{profile}.dbc").write_bytes((PROFILES / f"{profile}.dbc").read_bytes())
    copy = tmp_path / "mine.toml"
    text = (PROFILES / f"{profile}.toml").read_text()
    copy.write_text(text)
    with pytest.raises(ConfigError, match=f"mine.toml: confirm: not confirmed: {what}.*set it to true"):
        open_bridge(mission(), parsed("--profile", str(copy)))
    copy.write_text(text.replace("= false", "= true"))
    assert open_bridge(mission(), parsed("--profile", str(copy))).max_speed_m_s == 1.0


@pytest.mark.parametrize("name", ["agilex_limo", "agilex_ranger"])
def test_nobody_says_when_these_stop_by_themselves(name):
    assert load_profile(PROFILES / f"{name}.toml").firmware_timeout_s is None


def drive(bridge, velocity, arrived):
    """Command until the state is as wanted."""
    numbers = itertools.count()

    def command():
        bridge.write(Command(3, next(numbers), time.monotonic(), (0.0, 0.0), velocity))
        return (state := bridge.read()) is not None and arrived(state)

    until(command, 0.02, lambda: f"{bridge.phase}, {bridge.counts}, {bridge.read()}")


@pytest.mark.skipif(sys.version_info < (3, 11), reason="odrive-can needs Python 3.11")
def test_two_mock_odrives_drive_and_stop():
    mock = pytest.importorskip("odrive_can.mock")
    can = pytest.importorskip("can")
    address = multicast_address()
    channel, _, port = address.removeprefix("udp_multicast:").partition("?port=")
    drives = []

    async def play(ending):
        for axis in (0, 1):
            drives.append(
                mock.ODriveCANMock(axis, can.Bus(interface="udp_multicast", channel=channel, port=int(port)))
            )
        tasks = [asyncio.create_task(drive.main()) for drive in drives]
        listening.set()
        while not ending.is_set():
            await asyncio.sleep(0.02)
        for task in tasks:
            task.cancel()

    listening, ending = threading.Event(), threading.Event()
    thread = threading.Thread(target=lambda: asyncio.run(play(ending)))
    thread.start()
    assert listening.wait(HANG_S)  # the guard asks each drive to enable only once
    profile = patient_profile("odrive_cansimple")
    spec = patient_spec(
        address,
        profile,
        limits=SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0)),
        allow_unsafe_firmware_timeout=True,
    )
    try:
        with GuardedBridge(spec) as bridge:
            drive(bridge, (0.3, 0.0), lambda state: state.velocity_m_s[0] > 0.29)
            assert [drive.odrive.axis_state for drive in drives] == ["CLOSED_LOOP_CONTROL"] * 2
            assert sum(drive.odrive.model.setpoint for drive in drives) == pytest.approx(
                0.6 * 1.87241, rel=0.05
            )
        until(lambda: [drive.odrive.axis_state for drive in drives] == ["IDLE"] * 2)
        assert [drive.odrive.model.setpoint for drive in drives] == [0.0, 0.0]
    finally:
        ending.set()
        thread.join()
        for drive_ in drives:
            drive_.notifier.stop()


class Limo:
    """A Limo at the other end of a pseudo terminal: takes command, reports what it was told to do."""

    def __init__(self) -> None:
        self.end, self._computer = pty.openpty()
        tty.setraw(self.end)
        os.set_blocking(self.end, False)
        self.port = os.ttyname(self._computer)
        self.frames: list[Frame] = []
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()
        os.close(self.end)
        os.close(self._computer)

    def _run(self):
        reader, mode, motion = FrameReader(), 0, bytes(8)
        while not self._ending.wait(0.02):
            with contextlib.suppress(BlockingIOError):
                for frame in reader.feed(os.read(self.end, 4096)):
                    self.frames.append(frame)
                    mode = frame.data[0] if frame.frame_id == 0x421 else mode
                    motion = frame.data if frame.frame_id == 0x111 else motion
            for frame in (Frame(0x211, bytes([0, mode, 0, 110, 0, 0, 2, 0])), Frame(0x221, motion)):
                with contextlib.suppress(BlockingIOError):
                    os.write(self.end, frame_bytes(frame, 0))


def test_a_limo_drives_sideways_over_its_serial_port():
    with Limo() as limo:
        profile = patient_profile("agilex_limo")
        spec = patient_spec(
            limo.port,
            profile,
            limits=SetpointLimits(1.0, (-1.0, -1.0), (1.0, 1.0)),
            allow_unsafe_firmware_timeout=True,
        )
        with GuardedBridge(spec) as bridge:
            drive(bridge, (0.0, 0.25), lambda state: state.position_m[1] > 0.01)
            assert bridge.read().velocity_m_s == pytest.approx((0.0, 0.25))
        until(lambda: limo.frames[-1] == Frame(0x421, bytes(8)))
    assert limo.frames[0] == Frame(0x111, bytes(8))
    assert limo.frames[1] == Frame(0x421, bytes([1, 0, 1, 0, 0, 0, 0, 0]))
    assert limo.frames[-4:] == [Frame(0x111, bytes(8))] * 3 + [Frame(0x421, bytes(8))]
    assert Frame(0x111, bytes.fromhex("0000 0000 00fa 0000")) in limo.frames
