"""Checks of an autopilot before a run: what it says of itself. No heartbeat, setpoint or command is sent."""

import select
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec

from edge_runtime.common.key_file import read_key
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, ok, warn
from edge_runtime.errors import EdgeError
from firmware_bridge.guard.diagnostics import firmware_timeout
from firmware_bridge.mavlink.bridge import MavlinkFlags, make_spec
from firmware_bridge.mavlink.channel import Channel
from firmware_bridge.mavlink.clock import Clock
from firmware_bridge.mavlink.codec import Tally
from firmware_bridge.mavlink.messages import Heartbeat, Parameter, ParameterRequest
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import Mode, Profile, find_profile

LISTEN_S = 5.0
"""Heartbeats come every second; a bad radio needs a few, and as long for the answer about a parameter."""
ASK_AGAIN_S = 0.4


class Heard(msgspec.Struct, frozen=True):
    """What an autopilot said within a bounded time."""

    heartbeat: Heartbeat | None
    firmware_timeout_s: float | None
    tally: Tally


def examine_link(mission: Mission, options: MavlinkFlags) -> Iterator[Finding]:
    """Yield what is found.

    Raises:
        ConfigError: at once, if a flag does not fit; a key that cannot be used is a finding.
    """
    manifest = mission.bundle.manifest
    keyless = msgspec.structs.replace(options, signing_key="", require_signing=False)
    spec = make_spec(mission.robot_id, manifest, keyless, mission.rate_hz)
    link = msgspec.json.decode(spec.options, type=MavlinkOptions)
    return _findings(options, msgspec.structs.replace(link, signing_key=options.signing_key))


def _findings(flags: MavlinkFlags, options: MavlinkOptions) -> Iterator[Finding]:
    key = examine("signing", partial(signing, flags))
    yield key
    if key.verdict is Verdict.FAIL:
        return
    profile = find_profile(options.autopilot)
    try:
        heard = listen(options, profile)
    except (EdgeError, OSError) as error:
        yield Finding(Verdict.FAIL, str(error), name="autopilot")
        return
    yield examine("autopilot", partial(autopilot, heard, options))
    if heard.heartbeat is not None:
        yield examine("mode", partial(mode, heard.heartbeat, profile))
        source = f"as the autopilot answers for {profile.timeout_parameter}"
        unsafe = flags.guard.allow_unsafe_firmware_timeout
        yield examine(
            "firmware timeout",
            lambda: firmware_timeout(heard.firmware_timeout_s, source, allow_unsafe=unsafe),
        )


def signing(flags: MavlinkFlags) -> Finding:
    """Whether frames are signed, and with a key that can be used.

    Raises:
        ConfigError: if the key file is missing, open to others or no key.
    """
    if flags.signing_key:
        read_key(Path(flags.signing_key))
        return ok(f"on, the key {flags.signing_key} is readable")
    remedy = "pass --mavlink-signing-key FILE"
    if flags.require_signing:
        return fail("off, though --mavlink-require-signing asks for it", remedy)
    if flags.address.startswith("serial:"):
        return ok("off, on a wire of its own")
    return warn("off: whoever reaches this network can command the robot", remedy)


def listen(options: MavlinkOptions, profile: Profile, longest_s: float = LISTEN_S) -> Heard:
    """Wait for a heartbeat, and for the answer to the question what the firmware's timeout is.

    Asks for one parameter and for the time, which changes nothing; an autopilot behind ``udpout`` learns
    from that where to send.

    Raises:
        EdgeError: if key or port cannot be used, or the port is lost.
    """
    channel = Channel(options)
    channel.open()
    try:
        return _converse(channel, profile.timeout_parameter, longest_s)
    finally:
        channel.close()


def _converse(channel: Channel, parameter: str, longest_s: float) -> Heard:
    heartbeat: Heartbeat | None = None
    timeout_s: float | None = None
    now_s = ask_s = time.monotonic()
    end_s = now_s + longest_s
    while (heartbeat is None or timeout_s is None) and now_s < end_s:
        if now_s >= ask_s:
            channel.send(Clock().request(now_s), now_s)
            channel.send(ParameterRequest(parameter), now_s)
            ask_s = now_s + ASK_AGAIN_S
        select.select(channel.filenos(), (), (), max(min(ask_s, end_s) - now_s, 0.0))
        for content in channel.receive():
            match content:
                case Heartbeat():
                    heartbeat = content
                case Parameter(name=name, value=value) if name == parameter:
                    timeout_s = max(value, 0.0)
                case _:
                    pass
        now_s = time.monotonic()
    return Heard(heartbeat, timeout_s, channel.tally)


def autopilot(heard: Heard, options: MavlinkOptions) -> Finding:
    """Whether the autopilot is there, and what else came in its place."""
    tally = heard.tally
    refused = ", ".join(f"{count} {why.name.lower()}" for why, count in tally.refused.items() if count)
    counts = f"{tally.accepted} frames taken, {tally.damaged} damaged, {refused or 'none'} refused by signing"
    if heard.heartbeat is not None:
        return ok(f"heartbeat of system {options.system_id} on {options.address} ({counts})")
    return fail(
        f"no heartbeat of system {options.system_id} on {options.address} within {LISTEN_S:g} s ({counts})",
        "check power, wiring, port, --mavlink-system, MAVLink 2 and the signing key",
    )


def mode(heartbeat: Heartbeat, profile: Profile) -> Finding:
    """Which mode the autopilot is in, and whether it is armed."""
    known: tuple[Mode, ...] = (profile.command_mode, profile.stop_mode)
    names = [mode.name for mode in known if mode.reported == heartbeat.custom_mode]
    name = (
        names[0] if names else f"{heartbeat.custom_mode:#x}, another than {known[0].name} or {known[1].name}"
    )
    if heartbeat.armed:
        return warn(f"{name}, armed", "it may move: disarm it, or keep clear")
    return ok(f"{name}, disarmed")
