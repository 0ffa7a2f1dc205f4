"""What the benchmark writes: one row a fault and bridge."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from benchmarks.common.result_page import page, table
from edge_runtime.tools.report.page import chart

DRAWN_MS = 100.0
"""The firmware's own timeout would hide what the guard takes."""


class FaultRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One line of the table; what was only counted has no times, what was timed has no count."""

    fault: str
    bridge: str
    trials: int
    p50_ms: float | None = None
    """Until the stop command stands on the wire."""
    p95_ms: float | None = None
    max_ms: float | None = None
    p95_m: float | None = None
    """Distance from the fault to rest."""
    repeated: int = 0
    """Trials that a busy machine stopped before their fault, run again."""
    passed: int | None = None
    """Bad commands or forged frames that got through."""


def timed(
    fault: str, bridge: str, seconds: Sequence[float], repeated: int = 0, metres: Sequence[float] = ()
) -> FaultRow:
    """Summarize times, and distances where there are any."""
    p50, p95 = (float(value) for value in np.percentile(seconds, (50.0, 95.0)) * 1e3)
    p95_m = float(np.percentile(metres, 95.0)) if metres else None
    return FaultRow(fault, bridge, len(seconds), p50, p95, max(seconds) * 1e3, p95_m=p95_m, repeated=repeated)


def measured(row: FaultRow) -> tuple[str, str]:
    """What a row says something about: a newer one takes its place."""
    return row.fault, row.bridge


def faults_table(rows: Sequence[FaultRow]) -> str:
    """Format rows as a Markdown table."""
    lines = []
    for row in rows:
        times = [_cell(value) for value in (row.p50_ms, row.p95_ms, row.max_ms)]
        metres = "" if row.p95_m is None else f"{row.p95_m:.3f}"
        passed = "" if row.passed is None else str(row.passed)
        lines.append([row.fault, row.bridge, f"{row.trials:,}", *times, metres, passed])
    return table(["fault", "bridge", "trials", "p50 ms", "p95 ms", "max ms", "p95 m", "passed"], lines)


def render(rows: Sequence[FaultRow]) -> str:
    """The rows as Markdown; ``stops.svg`` is what `draw` returns."""
    return page(
        "How fast the robot is stopped",
        "faults",
        "Milliseconds until the stop command stands on the wire, measured at the firmware's end.",
        "## Faults",
        faults_table(rows),
        f"![95th percentiles in milliseconds, of those up to {DRAWN_MS:g}](stops.svg)",
    )


def draw(rows: Sequence[FaultRow]) -> str:
    """95th percentiles as bars, as SVG."""
    drawn: dict[str, dict[str, float]] = {}
    for row in rows:
        if row.p95_ms is not None and row.p95_ms <= DRAWN_MS:
            drawn.setdefault(row.fault, {})[row.bridge] = row.p95_ms
    return chart.bars(drawn, "ms")


def _cell(milliseconds: float | None) -> str:
    """Show three digits."""
    if milliseconds is None:
        return ""
    return f"{milliseconds:.{max(2 - math.floor(math.log10(milliseconds)), 0)}f}"
