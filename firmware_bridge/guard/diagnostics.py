"""The check that every firmware must pass: who stops the robot when the guard itself has died."""

from edge_runtime.doctor.finding import Finding, fail, ok, warn
from firmware_bridge.guard.core import firmware_timeout_fault


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
