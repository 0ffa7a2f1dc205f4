"""Checks of a CAN robot before a run: the bus as Linux knows it, and what the firmware says unasked."""

import select
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec

from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, ok, warn
from edge_runtime.errors import BridgeError
from firmware_bridge.can.bridge import CONFIRMING, CanFlags, make_spec
from firmware_bridge.can.bus import bus_arguments
from firmware_bridge.can.interface import Interface, show_interface
from firmware_bridge.can.link import CanLink, make_link
from firmware_bridge.can.profile import Profile, load_profile, profile_path
from firmware_bridge.guard.diagnostics import firmware_timeout, stopping_distances
from firmware_bridge.guard.link import Condition, Health
from firmware_bridge.guard.spec import GuardSpec

LISTEN_S = 2.0
"""Longer than the slowest feedback of any shipped profile takes to come."""
KINDS = ("can", "vcan", "vxcan")


def examine_link(mission: Mission, options: CanFlags) -> Iterator[Finding]:
    """Yield what is found; nothing is sent, but drives with a watchdog are asked for it.

    Raises:
        ConfigError: at once, if profile, DBC, limits or rates do not fit.
    """
    spec = make_spec(mission.robot_id, mission.bundle.manifest, options, mission.rate_hz)
    return _findings(mission, spec, options, load_profile(profile_path(options.profile)))


def _findings(mission: Mission, spec: GuardSpec, options: CanFlags, profile: Profile) -> Iterator[Finding]:
    if profile.transport == "limo_serial":
        yield examine("serial port", partial(serial_port, options.bus))
    elif (place := bus_arguments(options.bus))["interface"] == "socketcan":
        yield from examine_interface(str(place["channel"]), profile.period_s)
    else:
        yield examine("CAN interface", lambda: ok(f"{place['interface']}: not one of Linux's interfaces"))
    link = make_link(msgspec.structs.replace(spec, arm=False))
    yield examine("feedback", partial(feedback, link, spec.arm))
    unsafe = spec.allow_unsafe_firmware_timeout
    yield examine(
        "firmware timeout",
        lambda: firmware_timeout(link.firmware_timeout_s, link.firmware_timeout_source, allow_unsafe=unsafe),
    )
    yield examine("stopping", lambda: stopping_distances(mission, spec, link.firmware_timeout_s))
    for what, confirmed in profile.confirm.items():
        yield examine("setting", partial(setting, what, confirmed=confirmed))


def setting(what: str, *, confirmed: bool) -> Finding:
    """Whether somebody has looked at what no message tells."""
    return ok(f"confirmed: {what}") if confirmed else fail(f"not confirmed: {what}", CONFIRMING)


def examine_interface(name: str, period_s: float) -> Iterator[Finding]:
    """Check one of Linux's CAN interfaces for frames that go out every ``period_s``."""
    try:
        interface = show_interface(name)
    except BridgeError as error:
        yield Finding(Verdict.FAIL, str(error), name="CAN interface")
        return
    yield examine("CAN interface", partial(is_up, interface))
    if interface.linkinfo.info_kind == "can":
        yield examine("bit rate", partial(bit_rate, interface))
        yield examine("restart-ms", partial(restart, interface))
        yield examine("transmit queue", partial(queue, interface, period_s))


def is_up(interface: Interface) -> Finding:
    """Whether frames can pass."""
    name, kind = interface.ifname, interface.linkinfo.info_kind
    state = interface.linkinfo.info_data.state
    if kind not in KINDS:
        return fail(f"{name} is no CAN interface", "see: ip link show type can")
    if "UP" not in interface.flags:
        return fail(f"{name} is down", f"run: ip link set {name} up")
    if state == "BUS-OFF":
        return fail(
            f"{name} is bus-off", f"check wiring and bit rate, then: ip link set {name} type can restart"
        )
    if state in ("ERROR-WARNING", "ERROR-PASSIVE"):
        return warn(f"{name} is up, {state}: many errors", "check wiring, termination and bit rate")
    return ok(f"{name} is up{', ' + state if state else ', virtual'}")


def bit_rate(interface: Interface) -> Finding:
    """The bit rate; no frame of a robot with another one comes through."""
    if interface.bitrate > 0:
        return ok(f"{interface.bitrate} bit/s")
    if "UP" in interface.flags:  # a serial adapter, set up by other means
        return warn("chosen by the adapter, Linux does not know it", "make sure that it is the robot's")
    return fail("not set", f"run: ip link set {interface.ifname} type can bitrate 500000")


def restart(interface: Interface) -> Finding:
    """Whether the controller joins the bus again by itself; commands that waited would then still go out."""
    restart_ms = interface.linkinfo.info_data.restart_ms
    if restart_ms == 0:
        return ok("0: stays off the bus after bus-off until it is restarted by hand")
    return warn(
        f"{restart_ms}: after bus-off, commands that waited in the queue are still sent",
        f"run: ip link set {interface.ifname} type can restart-ms 0",
    )


def queue(interface: Interface, period_s: float) -> Finding:
    """How long a stop would wait behind a queue full of older commands."""
    known = "" if interface.bitrate else " or more"
    detail = f"{interface.txqlen} frames, {interface.queue_s * 1e3:.1f} ms{known} until the last has left"
    if interface.queue_s <= period_s:
        return ok(detail)
    return warn(detail, f"a stop waits behind them; run: ip link set {interface.ifname} txqueuelen 10")


def serial_port(device: str) -> Finding:
    """Whether the device is there; listening opens it."""
    if not Path(device).is_char_device():
        return fail(f"{device} is no serial port", "see: ls -l /dev/serial/by-id")
    return ok(f"{device} is there")


def feedback(link: CanLink, arm: bool, listen_s: float = LISTEN_S) -> Finding:
    """What the firmware says of itself within a bounded time; nothing is sent.

    Raises:
        BridgeError: if the bus cannot be opened or is lost.
    """
    link.open()
    try:
        health = _listen(link, listen_s)
    finally:
        link.close()
    found = _judge(health, arm)
    if not link.malformed:
        return found
    detail = f"{found.detail}; {link.malformed} frames could not be read"
    if found.verdict is not Verdict.OK:
        return msgspec.structs.replace(found, detail=detail)
    return warn(detail, "check wiring, termination, bit rate and --profile")


def _listen(link: CanLink, listen_s: float) -> Health:
    """Receive until all feedback is fresh or somebody else has the robot, or until time is up."""
    now_s = time.monotonic()
    end_s = now_s + listen_s
    while (health := link.health(now_s)).condition is Condition.FAULT and now_s < end_s:
        select.select(link.filenos(), (), (), end_s - now_s)
        now_s = time.monotonic()
        link.receive(now_s)
    return health


def _judge(health: Health, arm: bool) -> Finding:
    if health.condition is Condition.OVERRIDE:
        return fail(health.detail, "release the emergency stop, give the robot free on the remote control")
    if health.condition is Condition.FAULT:
        return fail(health.detail, "switch the robot on; check wiring, bit rate, --profile; clear its faults")
    heard = f"fresh; {health.warning}" if health.warning else "fresh"
    if health.condition is Condition.READY:
        return warn(
            f"{heard}, and the firmware takes commands already", "keep clear: it may be driven without --arm"
        )
    if not arm:
        remedy = "edge-run commands nothing until it is enabled: pass --arm"
        return warn(f"{heard}; {health.detail}", remedy)
    if health.warning:
        return warn(f"{heard}; {health.detail}, --arm enables it", "look at the robot")
    return ok(f"fresh; {health.detail}, --arm enables it")
