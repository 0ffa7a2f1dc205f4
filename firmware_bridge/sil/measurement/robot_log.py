"""What a robot's own log tells of its decisions: on which pose, on which teammates' states."""

from array import array
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.writer import MCAP0_MAGIC

from edge_runtime.common.arrays import Floats
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Tick


class RobotLog(NamedTuple):
    """One robot's ticks, in order; monotonic seconds."""

    decided_s: Floats
    used_pose_s: Floats
    """As the runtime stamped it."""
    used_ages_s: Floats
    """Ages of the teammates' states that a decision rested on, decision by decision."""
    used_at_s: Floats
    """When; as long as ``used_ages_s``."""
    versions: Floats
    """Of the objectives that each decision followed."""
    due_s: Floats
    """When each tick was due."""
    misses: Floats
    """Deadlines that the loop had counted as missed, at each decision."""
    fresh: Floats
    """1 where the decision was the first on that message, 0 where it was used before."""
    used_x_m: Floats
    """Where the robot was by the pose that it used."""

    def message_ages_s(self, begin_s: float, end_s: float) -> Floats:
        """Return the ages of messages when they were first used, within a time."""
        return self.used_ages_s[self._within(begin_s, end_s) & (self.fresh == 1.0)]

    def state_ages_s(self, begin_s: float, end_s: float) -> Floats:
        """Return the ages of all states used, within a time."""
        return self.used_ages_s[self._within(begin_s, end_s)]

    def changes_s(self) -> tuple[tuple[float, int], ...]:
        """Return (time, version) of each first decision under other objectives."""
        changed = np.flatnonzero(np.diff(self.versions)) + 1
        return tuple((float(self.decided_s[tick]), int(self.versions[tick])) for tick in changed)

    def gaps_s(self, begin_s: float, end_s: float, longest_s: float) -> tuple[tuple[float, float], ...]:
        """Return (from, to) of each time within which the log lacks decisions for over ``longest_s``."""
        inside = self.decided_s[(self.decided_s >= begin_s) & (self.decided_s < end_s)]
        edges = np.concatenate([[begin_s], inside, [end_s]])
        long = np.flatnonzero(np.diff(edges) > longest_s)
        return tuple((float(edges[i]), float(edges[i + 1])) for i in long)

    def _within(self, begin_s: float, end_s: float) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        return (self.used_at_s >= begin_s) & (self.used_at_s < end_s)


def read_robot_log(folder: Path) -> RobotLog:
    """Return what the log in a folder holds, up to its damage if it has any."""
    decided, pose, ages, at, versions, due, misses, fresh, x_m = (array("d") for _ in range(9))
    newest: dict[int, float] = {}
    # A full disk leaves files without even their first bytes.
    for path in sorted(path for path in folder.glob("*.mcap") if path.stat().st_size > len(MCAP0_MAGIC)):
        for tick in read_log(path):
            if not isinstance(tick, Tick):
                continue
            decided.append(tick.command.stamp_s)
            pose.append(tick.state.own.stamp_s)
            x_m.append(tick.state.own.position_m[0])
            versions.append(tick.inputs.objectives_version)
            due.append(tick.inputs.deadline_s)
            misses.append(tick.inputs.misses)
            for mate in tick.state.teammates:
                ages.append(mate.age_s)
                at.append(tick.command.stamp_s)
                fresh.append(newest.get(mate.state.robot_id) != mate.state.stamp_s)
                newest[mate.state.robot_id] = mate.state.stamp_s
    columns = (decided, pose, ages, at, versions, due, misses, fresh, x_m)
    return RobotLog(*(np.array(column) for column in columns))
