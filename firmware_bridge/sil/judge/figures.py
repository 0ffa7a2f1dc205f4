"""From times of arrival to figures: rate, jitter, misses, ages."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from edge_runtime.common.arrays import Floats
from edge_runtime.control.rate import Percentiles

EARLY_SHARE = 0.25
"""A command up to this share of a period before its tick's usual time still belongs to that tick."""


PUNCTUAL_SHARE = 0.25
"""A command is punctual within this share of a period around its tick's usual time."""


class LoggedTicks(NamedTuple):
    """What a runtime's log tells of its ticks, in order."""

    due_s: Floats
    decided_s: Floats
    """When it decided on its command."""
    misses: Floats
    """Deadlines that the loop had counted as missed by then."""


class MissCounts(NamedTuple):
    """The same misses, counted at both ends of the wire."""

    lacking: int
    """Ticks that brought the firmware no command, neither in time nor late."""
    counted: int
    """Deadlines that the runtime's loop counted as missed meanwhile."""
    late: int
    """Commands that came, but so late that their own ticks brought none."""


def percentiles(values: npt.ArrayLike, scale: float = 1.0) -> Percentiles | None:
    """Return the distribution of values times ``scale``; None where there are none."""
    array = np.asarray(values, np.float64) * scale
    if not array.size:
        return None
    p50, p99, p99_9 = np.percentile(array, [50.0, 99.0, 99.9]).tolist()
    return Percentiles(p50, p99, p99_9, float(array.max()))


def ticks_of(arrival_s: Floats, period_s: float) -> npt.NDArray[np.int64]:
    """Return the number of each arrival's tick on the sender's grid of deadlines.

    The grid's phase is that of most arrivals; a late command still belongs to its own tick as long as it
    comes within its period, because the sender skips ticks that would come later.
    """
    phase = 2.0 * np.pi * arrival_s / period_s
    usual = np.arctan2(np.median(np.sin(phase)), np.median(np.cos(phase))) / (2.0 * np.pi)
    ticks: npt.NDArray[np.int64] = np.floor(arrival_s / period_s - usual + EARLY_SHARE).astype(np.int64)
    return ticks


def missed_bursts(arrival_s: Floats, period_s: float, begin_s: float, end_s: float) -> npt.NDArray[np.int64]:
    """Return how many ticks in a row brought no command, for every such gap within [begin, end)."""
    whole = round((end_s - begin_s) / period_s)
    inside = arrival_s[(arrival_s >= begin_s) & (arrival_s < end_s)]
    if not inside.size:
        return np.array([whole])
    ticks = np.unique(ticks_of(inside, period_s))
    gaps = np.diff(ticks) - 1
    before = round((inside[0] - begin_s) / period_s - 0.5)
    after = whole - (int(ticks[-1] - ticks[0]) + 1) - before
    every = np.concatenate([[before], gaps, [after]])
    return every[every > 0]


def miss_counts(
    arrival_s: Floats, ticks: LoggedTicks, period_s: float, begin_s: float, end_s: float
) -> MissCounts | None:
    """Count the misses within [begin, end) at the firmware and in the loop; None if they cannot be compared.

    Both are counted from one punctual command to another that the log knows, so that no tick is cut in two.

    Args:
        arrival_s: commands at the firmware, ascending.
        ticks: of the runtime's log.
        period_s: of the control loop.
        begin_s: of the time within which is counted.
        end_s: of it.
    """
    inside = arrival_s[(arrival_s >= begin_s) & (arrival_s < end_s)]
    if not (inside.size and ticks.decided_s.size):
        return None
    decision = np.searchsorted(ticks.decided_s, inside, side="right") - 1
    after = np.where(decision >= 0, (inside - ticks.due_s[decision]) / period_s, np.inf)
    in_its_tick = after < 1.0
    if not in_its_tick.any():
        return None
    usual = np.median(after[in_its_tick])
    punctual = np.flatnonzero(in_its_tick & (np.abs(after - usual) < PUNCTUAL_SHARE))
    if not punctual.size:
        return None
    first, last = punctual[0], punctual[-1]
    due = round(float((inside[last] - inside[first]) / period_s))
    counted = ticks.misses[decision[last]] - ticks.misses[decision[first]]
    lacking = due - int(last - first)
    brought = np.unique(ticks_of(inside[first : last + 1], period_s)).size
    return MissCounts(lacking, int(counted), due + 1 - int(brought) - lacking)


def pose_ages(
    arrival_s: Floats,
    decided_s: Floats,
    used_pose_s: Floats,
    measured_s: Floats,
    tolerance_s: float,
) -> Floats:
    """Return the age of the pose behind each command that arrived, in seconds.

    Args:
        arrival_s: commands at the firmware.
        decided_s: when the runtime took each decision, ascending; with
        used_pose_s: its own stamp of the pose that it used.
        measured_s: when the firmware measured each pose that it sent, ascending.
        tolerance_s: how far the runtime's stamp of a pose may lie before the measurement.

    Commands keep their order and arrive after they were decided: each arrival belongs to the newest decision
    before it. The runtime's stamp belongs to the newest measurement before the stamp.
    """
    if not (decided_s.size and measured_s.size):
        return np.empty(0)
    decision = np.searchsorted(decided_s, arrival_s, side="right") - 1
    known = decision >= 0
    measurement = np.searchsorted(measured_s, used_pose_s[decision[known]] + tolerance_s, side="right") - 1
    ages: Floats = (arrival_s[known] - measured_s[np.maximum(measurement, 0)])[measurement >= 0]
    return ages


def halts(
    arrival_s: Floats, speed: Floats, period_s: float, begin_s: float, end_s: float
) -> tuple[tuple[float, float], ...]:
    """Return (from, to) of each time without a command to move that lasted over three periods."""
    moving = arrival_s[(speed != 0.0) & (arrival_s >= begin_s) & (arrival_s < end_s)]
    edges = np.concatenate([[begin_s], moving, [end_s]])
    long = np.flatnonzero(np.diff(edges) > 3.0 * period_s)
    return tuple((float(edges[i] - begin_s), float(edges[i + 1] - begin_s)) for i in long)
