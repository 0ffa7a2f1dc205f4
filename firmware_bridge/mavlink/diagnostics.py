"""Checks of an autopilot before a run: what it says of itself. No heartbeat, setpoint or interval is sent."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec

from edge_runtime.common.key_file import read_key
from edge_runtime.control.mission import Mission
from edge_runtime.doctor.finding import Finding, Verdict, examine, fail, ok, warn
from edge_runtime.errors import EdgeError
from firmware_bridge.guard.diagnostics import firmware_timeout, stopping_distances
from firmware_bridge.guard.spec import GuardSpec
from firmware_bridge.mavlink.bridge import MavlinkFlags, make_spec
from firmware_bridge.mavlink.conversation import LISTEN_S, Heard, listen
from firmware_bridge.mavlink.messages import Heartbeat
from firmware_bridge.mavlink.opening import deafness, silence
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.pose_rate import longest_pose_s
from firmware_bridge.mavlink.profiles import AUTOPILOTS, COPTERS, ROVERS, Mode, Profile, find_profile
from firmware_bridge.mavlink.readiness import GROUNDED, rivalry
from firmware_bridge.mavlink.streams import fastest_us


def examine_link(mission: Mission, options: MavlinkFlags) -> Iterator[Finding]:
    """Yield what is found.

    Raises:
        ConfigError: at once, if a flag does not fit; a key that cannot be used is a finding.
    """
    manifest = mission.bundle.manifest
    keyless = msgspec.structs.replace(options, signing_key="", require_signing=False)
    spec = make_spec(mission.robot_id, manifest, keyless, mission.rate_hz)
    link = msgspec.json.decode(spec.options, type=MavlinkOptions)
    return _findings(mission, spec, options, msgspec.structs.replace(link, signing_key=options.signing_key))


def _findings(
    mission: Mission, spec: GuardSpec, flags: MavlinkFlags, options: MavlinkOptions
) -> Iterator[Finding]:
    key = examine("signing", partial(signing, flags))
    yield key
    if key.verdict is Verdict.FAIL:
        return
    try:
        heard = listen(options)
    except (EdgeError, OSError) as error:
        yield Finding(Verdict.FAIL, str(error), name="autopilot")
        return
    yield examine("autopilot", partial(autopilot, heard, options))
    heartbeat = heard.facts.vehicle.heartbeat
    if heartbeat is None:
        return
    profile = find_profile(options.autopilot)
    yield examine("vehicle", partial(vehicle, heard))
    yield examine("answers", partial(answers, heard, options))
    yield examine("mode", partial(mode, heartbeat, profile))
    yield examine("firmware timeout", partial(timeout, heard, flags, profile))
    yield examine("stopping", partial(stopping_distances, mission, spec, heard.facts.timeout_s))
    yield examine("pose", partial(pose, heard, options))
    yield examine("estimator", partial(estimator, heard))


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


def autopilot(heard: Heard, options: MavlinkOptions) -> Finding:
    """Whether the autopilot is there, alone, and what else came in its place."""
    channel, tally = heard.channel, heard.channel.tally
    if heard.facts.vehicle.heartbeat is None:
        return fail(silence(channel, options, LISTEN_S))
    if two := rivalry(channel):
        return fail(two)
    refused = ", ".join(f"{count} {why.name.lower()}" for why, count in tally.refused.items() if count)
    counts = f"{tally.accepted} frames taken, {tally.damaged} damaged, {refused or 'none'} refused by signing"
    found = f"heartbeat of system {options.system_id} on {options.address} ({counts})"
    if channel.impostors:
        return warn(found, f"{channel.impostors} heartbeats under its number come from what says it is none")
    return ok(found)


def vehicle(heard: Heard) -> Finding:
    """Whether it is the kind of vehicle that the profile's modes belong to, and flies if it is a copter."""
    found, beat = heard.facts.vehicle, heard.facts.vehicle.heartbeat
    if found.misfit or beat is None:
        return fail(found.misfit)
    name = f"{AUTOPILOTS[beat.autopilot]}, {({**ROVERS, **COPTERS})[beat.kind]}"
    return warn(name, GROUNDED) if found.grounded else ok(name)


def answers(heard: Heard, options: MavlinkOptions) -> Finding:
    """Whether the autopilot hears and answers what it is asked."""
    if heard.facts.clock.synchronised:
        return ok("it answers what it is asked")
    return fail(deafness(options))


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


def timeout(heard: Heard, flags: MavlinkFlags, profile: Profile) -> Finding:
    """Whether the autopilot stops by itself soon enough."""
    name = profile.timeout_parameter
    fixed = profile.fixed_timeout_s is not None and not heard.facts.answered(name)
    source = f"the firmware's own, it tells no {name}" if fixed else f"as the autopilot answers for {name}"
    remedy = "install guided_timeout.lua on the autopilot" if fixed else f"set {name}"
    unsafe = flags.guard.allow_unsafe_firmware_timeout
    return firmware_timeout(heard.facts.timeout_s, source, allow_unsafe=unsafe, remedy=remedy)


def pose(heard: Heard, options: MavlinkOptions) -> Finding:
    """Whether a position comes, and whether it can come often enough for the control rate."""
    told, period_s = heard.facts, options.motion.dt_s
    if told.estimate.state is None:
        return fail("no position", "wait for the estimator, or set its origin; a run would never move")
    needed = f"--rate {1.0 / period_s:g} needs one every {1e3 * longest_pose_s(period_s):.0f} ms"
    if told.loop_rate_hz is None:
        return ok(f"it sends its position when asked; {needed}")
    fastest_ms = 1e-3 * fastest_us(told.loop_rate_hz)
    granted = f"at SCHED_LOOP_RATE {told.loop_rate_hz:g} a position comes every {fastest_ms:g} ms at best"
    if 1e-3 * fastest_ms > longest_pose_s(period_s):
        return fail(f"{granted}, {needed}", "lower --rate or raise SCHED_LOOP_RATE")
    return ok(f"{granted}, {needed}")


def estimator(heard: Heard) -> Finding:
    """Whether the position may be driven by."""
    sound = heard.facts.soundness
    if fault := sound.fault(heard.now_s):
        return fail(fault)
    if not sound.told:
        return warn("it does not tell how sound its position is", "watch the robot: nothing else will notice")
    return ok("it vouches for its position")
