"""What the benchmark writes, and its page."""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from benchmarks.common.result_page import page, table
from edge_runtime.run.run_report import RunReport
from edge_runtime.tools.report.page import chart
from edge_runtime.tools.report.page.document import Verdict


class OverheadRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One quantity, medians over the rounds; ratios are of the same round."""

    quantity: str
    rate_hz: float
    realtime: bool
    rounds: int
    ratio_extremes: tuple[float, float]
    """Of any round."""
    ratio: float
    off_us: float
    on_us: float
    lost: int
    """Ticks that were not recorded."""


class HandOver(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the loop spends on handing one tick to its logger, in microseconds."""

    rate_hz: float
    p50_us: float
    p99_us: float
    max_us: float


class Overhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything that was measured."""

    rows: list[OverheadRow]
    hand_over: HandOver


QUANTITIES = ("tick p50", "tick p99", "wake p50", "wake p99")
Reports = Mapping[bool, RunReport]
"""Robot 0's, without and with recording and watching."""


def read_us(report: RunReport, quantity: str) -> float:
    """One of `QUANTITIES` in a run."""
    what, _, percentile = quantity.partition(" ")
    found = report.tick_us if what == "tick" else report.stage_us[what]
    return found.p50 if percentile == "p50" else found.p99


def make_row(quantity: str, rate: float, rounds: Sequence[Reports], *, realtime: bool) -> OverheadRow:
    """Sum all rounds up."""
    off, on = (np.array([read_us(reports[way], quantity) for reports in rounds]) for way in (False, True))
    medians = [float(np.median(values)) for values in (on / off, off, on)]
    extremes = float((on / off).min()), float((on / off).max())
    lost = sum(reports[True].log.lost for reports in rounds if reports[True].log)
    return OverheadRow(quantity, rate, realtime, len(rounds), extremes, *medians, lost)


ALLOWED = 1.05
"""p99 with recording and watching, in parts of p99 without."""


def render(measured: Overhead) -> str:
    """The results as Markdown; ``ticks.svg`` is what `draw` returns."""
    head = ["quantity", "off us", "on us", "on / off", "lowest", "highest"]
    cells = []
    for row in measured.rows:
        times = [f"{value:.1f}" for value in (row.off_us, row.on_us)]
        ratios = [f"{value:.3f}" for value in (row.ratio, *row.ratio_extremes)]
        cells.append([row.quantity, *times, *ratios])
    row, handed = measured.rows[0], measured.hand_over
    scheduling = "real-time" if row.realtime else "ordinary, as real-time was refused,"
    spent = [f"{value:.1f}" for value in (handed.rate_hz, handed.p50_us, handed.p99_us, handed.max_us)]
    return page(
        "What recording and watching cost the loop",
        "recording",
        f"Four robots at {row.rate_hz:g} Hz, {row.rounds} rounds, {scheduling} scheduling; {row.lost} lost.",
        "## A tick without (off) and with (on) its log and its watcher",
        f"Medians over the rounds; a ratio is of one round, whose runs follow each other. {ALLOWED:g} asked.",
        table(head, cells),
        "![The same medians in microseconds](ticks.svg)",
        "## Handing a tick over to the logger, after the command is out",
        table(["rate Hz", "p50 us", "p99 us", "max us"], [spent]),
    )


def draw(rows: Sequence[OverheadRow]) -> str:
    """Off beside on, as SVG."""
    return chart.bars({row.quantity: {"off": row.off_us, "on": row.on_us} for row in rows}, "us")


def verdicts(measured: Overhead) -> list[Verdict]:
    """What the page's head says."""
    (p99,) = (row for row in measured.rows if row.quantity == "tick p99")
    return [
        Verdict("Tick p99, on / off", f"{p99.ratio:.3f}", f"at most {ALLOWED:g} asked", p99.ratio <= ALLOWED),
        Verdict("Ticks lost", str(p99.lost), good=p99.lost == 0),
        Verdict("Hand-over", f"{measured.hand_over.p50_us:.0f} us", "median, after the command"),
    ]
