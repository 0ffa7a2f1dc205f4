"""The page that a full run writes: results beside the machine that they were measured on."""

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from benchmarks.common.result_page import page, table
from benchmarks.latency.budgets import BudgetVerdict
from benchmarks.latency.cases import Case
from benchmarks.latency.footprint import Footprint
from benchmarks.latency.growth import Growth, paper_terms
from benchmarks.latency.machine import Machine
from benchmarks.latency.rows import LatencyRow


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that one full run found."""

    machine: Machine
    noise: list[str]
    """Empty if the machine was quiet."""
    default: list[LatencyRow]
    verdicts: list[BudgetVerdict]
    small: list[LatencyRow]
    """The 2x128 network."""
    sampled: list[LatencyRow]
    """Samplers, their steps and modes, see `benchmarks.latency.samplers`."""
    kernel: list[str]
    """What the kernel takes over, see `benchmarks.latency.native`."""
    growths: list[list[Growth]]
    """Of each sweep, every backend."""
    paced: list[LatencyRow]
    refusals: list[str]
    """Paced variants that the system did not permit."""
    footprints: list[Footprint]
    estimate: str
    """For a Jetson Orin Nano; empty on a Jetson: what was measured stands above."""
    loop: str = ""
    """The table of the real loop."""


def render(result: Result) -> str:
    """The page in Markdown; its pictures lie beside it as ``sweep_<i>.png`` and ``paced.png``."""
    return page(
        "Latency of one tick",
        "latency",
        _verdict(result.noise),
        _machine(result.machine),
        "## 3x256 SiLU, observation 32, d = 2, T = 10, M = 2, K = 3, one thread, interleaved",
        _rows(result.default),
        _bullets(result.verdicts),
        "## 2x128 SiLU",
        _rows(result.small),
        "## Samplers: at equal T, and at equal success in the steps of the packaged policies",
        render_samplers(result.sampled),
        "## What the kernel takes over, and batches",
        _bullets(result.kernel),
        "## Start of the process to the first action",
        _footprints(result.footprints),
        "## In a loop that sleeps between deadlines",
        _paced(result.paced),
        _bullets(f"not permitted here: {refusal}" for refusal in result.refusals),
        "![paced](paced.png)",
        "## The loop, from pose to command: four robots at 50 Hz, p50 / p99 of the worst one",
        result.loop,
        "## Growth, beside the paper's O(T (M K + M²))",
        *(_growth(index, growths) for index, growths in enumerate(result.growths)),
        *(("## Estimate for one core of a Jetson Orin Nano", result.estimate) if result.estimate else ()),
    )


def render_samplers(rows: Sequence[LatencyRow]) -> str:
    """The table of samplers, their steps and modes.

    Ratios are to eager PyTorch's row, and to the processor's limit of the same sampler, steps and mode.
    """
    header = ["backend", "sampler", "T", "mode", "median µs", "best round", "p99", "p99.9", "times eager"]
    least = {_way(row): row.ratio_to_eager for row in rows if row.backend == "limit"}
    lines = [[row.backend, *_way(row), *_durations(row), _ratio(row), _over(row, least)] for row in rows]
    return table([*header, "over the limit"], lines)


def _way(row: LatencyRow) -> tuple[str, str, str]:
    return row.sampler, str(row.T), row.mode


def _over(row: LatencyRow, least: Mapping[tuple[str, str, str], float | None]) -> str:
    limit = least.get(_way(row))
    return f"{limit / row.ratio_to_eager:.2f}" if limit and row.ratio_to_eager else ""


def render_short(
    case: Case, rows: Sequence[LatencyRow], verdicts: Sequence[BudgetVerdict], noise: Sequence[str]
) -> str:
    """The page of a short run."""
    return page(
        "Latency of one tick, short run",
        "latency --short",
        _verdict(noise),
        f"## {case}",
        _rows(rows),
        _bullets(verdicts),
    )


def _bullets(items: Iterable[object]) -> str:
    return "\n".join(f"- {item}" for item in items)


def _verdict(noise: Sequence[str]) -> str:
    if not noise:
        return "The machine was quiet: the run is valid."
    return "**INVALID: the machine was not quiet.** " + "; ".join(noise) + "."


def _machine(machine: Machine) -> str:
    p50, p99, p99_9 = machine.wake_us
    return _bullets(
        [
            f"processor: {machine.processor}, {machine.cores} cores, governor {machine.governor}",
            f"kernel {machine.kernel}, Python {machine.python}, numpy {machine.numpy}",
            f"compiled kernel's instruction set: {machine.engine or 'not built'}",
            f"wake-up latency (5 ms sleeps): p50 {p50:.0f}, p99 {p99:.0f}, p99.9 {p99_9:.0f} µs",
        ]
    )


def _rows(rows: Sequence[LatencyRow]) -> str:
    header = ["backend", "median µs", "best round", "p99", "p99.9", "times eager"]
    return table(header, [[row.backend, *_durations(row), _ratio(row)] for row in rows])


def _durations(row: LatencyRow) -> list[str]:
    return [f"{value:.1f}" for value in (row.median_us, row.best_us, row.p99_us, row.p99_9_us)]


def _ratio(row: LatencyRow) -> str:
    return "" if row.ratio_to_eager is None else f"{row.ratio_to_eager:.1f}"


def _footprints(footprints: Sequence[Footprint]) -> str:
    header = ["backend", "resident MiB", "first action ms"]
    return table(
        header, [[f.backend, f"{f.resident_mib:.1f}", f"{f.first_action_ms:.0f}"] for f in footprints]
    )


def _paced(rows: Sequence[LatencyRow]) -> str:
    header = ["loop", "median µs", "best part", "p99", "p99.9"]
    return table(header, [[row.loop, *_durations(row)] for row in rows])


def _growth(index: int, growths: Sequence[Growth]) -> str:
    sweep = growths[0].sweep
    header = [sweep.symbol, *(f"{growth.backend} µs" for growth in growths), "T (M K + M²)"]
    columns = zip(sweep.values, *(growth.microseconds for growth in growths), strict=True)
    lines = [
        [str(value), *(f"{us:.1f}" for us in cells), str(paper_terms(sweep.make(value)))]
        for value, *cells in columns
    ]
    grown = f"### {sweep.title}\n\n{table(header, lines)}"
    slopes = [f"{g.backend} {g.per_unit_us:.2f} µs each, exponent {g.exponent:.2f}" for g in growths]
    return f"{grown}\n\nAlong {sweep.symbol}: {'; '.join(slopes)}.\n\n![{sweep.symbol}](sweep_{index}.png)"
