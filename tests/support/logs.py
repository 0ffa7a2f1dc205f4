"""Logs for tests: recorded by edge-run, or written record by record."""

import time

from clocks import simulated_time
from msgspec.structs import replace

from edge_runtime.recording.log_file import LogFile
from edge_runtime.recording.reader import Damage, read_log
from edge_runtime.recording.schema import TICK_CHANNELS, End, Event, LoggedObjectiveSet, Start, Tick
from edge_runtime.run.edge_run import main

TOPICS = {Start: "start", LoggedObjectiveSet: "objectives", Event: "events", End: "end"}


def record(folder, *flags):
    """Drive a short run without a miss and return the files of its log."""
    before = set(folder.glob("*.mcap"))
    duration = () if "--duration" in flags else ("--duration", "0.6")
    with simulated_time():
        assert main(["--robot-id", "0", "--rate", "100", "--log-dir", str(folder), *duration, *flags]) == 0
    return sorted(set(folder.glob("*.mcap")) - before)


def ticks(path):
    return [item for item in read_log(path) if isinstance(item, Tick)]


def write(path, records, chunk_ticks=50):
    """Write a log of these records; a chunk ends after so many ticks."""
    file, now = LogFile(path), time.time_ns()
    for item in records:
        assert not isinstance(item, Damage)
        if isinstance(item, Tick):
            for topic in TICK_CHANNELS:
                file.add(topic, getattr(item, topic), now, item.inputs.number)
            if item.inputs.number % chunk_ticks == chunk_ticks - 1:
                file.flush()
        else:
            file.add(TOPICS[type(item)], item, now)
    file.flush()
    file.close()
    return path


def in_space(path, target, height_m=2.0):
    """Copy a log of robots in the plane as one of robots in space that act by one more component."""

    def state(own):
        place, speed = (*own.position_m, height_m), (*own.velocity_m_s, 0.0)
        return replace(own, position_m=place, velocity_m_s=speed)

    def mates(found):
        return tuple(
            replace(mate, state=state(mate.state), intended_action=(*mate.intended_action, 0.0))
            for mate in found
        )

    def lifted(tick):
        inputs, action, command, team = tick.inputs, tick.action, tick.command, tick.state
        team = replace(team, own=state(team.own), teammates=mates(team.teammates), silent=mates(team.silent))
        return replace(
            tick,
            inputs=replace(
                inputs, start=(*inputs.start, 0.0), previous_action=(*inputs.previous_action, 0.0)
            ),
            state=team,
            action=replace(action, action=(*action.action, 0.0), correction=(*action.correction, 0.0)),
            command=replace(
                command, action=(*command.action, 0.0), velocity_m_s=(*command.velocity_m_s, 0.0)
            ),
        )

    def placed(start):
        robots = tuple(
            replace(robot, start_m=(*robot.start_m, height_m), goal_m=(*robot.goal_m, height_m))
            for robot in start.fleet.robots
        )
        return replace(start, fleet=replace(start.fleet, robots=robots))

    change = {Tick: lifted, Start: placed}
    return write(target, [change.get(type(item), lambda one: one)(item) for item in read_log(path)])


def with_tick(path, target, number, **changes):
    """Copy a log with parts of one tick exchanged: ``command=lambda command: ...``."""
    records = list(read_log(path))
    for index, item in enumerate(records):
        if isinstance(item, Tick) and item.inputs.number == number:
            parts = {name: change(getattr(item, name)) for name, change in changes.items()}
            records[index] = replace(item, **parts)
    return write(target, records)
