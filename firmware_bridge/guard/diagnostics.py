"""Checks of every firmware: who stops the robot when the guard itself has died, and how far it gets."""

from edge_runtime.control.bridge import Reaction
from edge_runtime.control.mission import Mission
from edge_runtime.control.stopping import describe, stopping
from edge_runtime.doctor.finding import Finding, fail, ok, warn
from firmware_bridge.guard.core import firmware_timeout_fault
from firmware_bridge.guard.spec import GuardSpec


def firmware_timeout(
    timeout_s: float | None, source: str, *, allow_unsafe: bool, remedy: str = "set it"
) -> Finding:
    """Whether the guard would start with this timeout; ``source`` says who told it."""
    fault = firmware_timeout_fault(timeout_s)
    if not fault:
        return ok(f"{timeout_s:g} s, {source}; the guard accepts it")
    detail = f"{fault}, {source}"
    if allow_unsafe:
        return warn(detail, "nothing stops the robot if the guard dies: keep the emergency stop at hand")
    return fail(detail, f"the guard refuses to start: {remedy}, or pass --allow-unsafe-firmware-timeout")


def stopping_distances(mission: Mission, spec: GuardSpec, timeout_s: float | None) -> Finding:
    """How far the robot travels after each fault, and whether the safety margin leaves room for it."""
    reaction = Reaction(spec.deadline_s, timeout_s, spec.deceleration_m_s2)
    found = stopping(mission, spec.limits.speed_m_s, reaction)
    if found.too_long:
        return warn(describe(found), "drive slower, widen the margin, or shorten the firmware's timeout")
    return ok(describe(found))
