"""What happened in a run, told from one tick to the next."""

from collections.abc import Iterator
from typing import Final

from edge_runtime.recording.foxglove import Time
from edge_runtime.recording.schema import Event, LoggedObjectiveSet, Tick

INFO: Final = 2
WARNING: Final = 3
ERROR: Final = 4


def event(time_ns: int, level: int, name: str, message: str) -> Event:
    """Make an event of a moment in Unix nanoseconds."""
    return Event(unix_time(time_ns), level, name, message)


def unix_time(time_ns: int) -> Time:
    """Split Unix nanoseconds as Foxglove has them."""
    return Time(*divmod(time_ns, 1_000_000_000))


def objectives_event(time_ns: int, chosen: LoggedObjectiveSet) -> Event:
    """Tell what steers from now on."""
    active = ", ".join(objective.name for objective in chosen.objectives if objective.active)
    text = f"version {chosen.version}: {active or 'none'} (guidance {chosen.mode})"
    return event(time_ns, INFO, "objectives", text)


def changes(before: Tick | None, tick: Tick, time_ns: int) -> Iterator[Event]:
    """Yield what changed since the tick before; None before the first."""
    reason = tick.command.stop_reason
    last_reason = before.command.stop_reason if before else ""
    if reason and reason != last_reason:
        yield event(time_ns, ERROR, "fault", reason)
    if last_reason and not reason:
        yield event(time_ns, INFO, "recovered", f"drives again after: {last_reason}")
    if tick.action.cut and not (before and before.action.cut):
        yield event(time_ns, WARNING, "cut", f"the deadline cut the sample after {tick.action.steps} steps")
    field = tick.observation.unfamiliar
    if field and field != (before.observation.unfamiliar if before else ""):
        yield event(time_ns, WARNING, "unfamiliar", f"{field} is outside of what training had")
    if before is None:
        return
    if missed := tick.inputs.misses - before.inputs.misses:
        yield event(time_ns, WARNING, "miss", f"{missed} deadlines missed")
    if gap := tick.inputs.number - before.inputs.number - 1:
        yield event(time_ns, WARNING, "gap", f"{gap} ticks were not recorded")
    heard, used = _mates(before), _mates(tick)
    for robot_id in sorted(heard - used):
        yield event(time_ns, WARNING, "lost", f"robot {robot_id} is not heard in time any more")
    for robot_id in sorted(used - heard):
        yield event(time_ns, INFO, "found", f"robot {robot_id} is heard")


def _mates(tick: Tick) -> set[int]:
    return {mate.state.robot_id for mate in tick.state.teammates}
