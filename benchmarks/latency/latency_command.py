"""``python -m benchmarks latency``: the tick beside everything that a user would pick instead."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from benchmarks.common.flags import make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.common.result_page import add_html_flag, check_writable, make_page, write_page
from benchmarks.latency import (
    actions,
    footprint,
    limit,
    loop,
    machine,
    native,
    orin_nano,
    paced,
    samplers,
    sixteen_bits,
)
from benchmarks.latency import latency_page as page
from benchmarks.latency.budgets import Budget, BudgetVerdict, judge, load_budgets
from benchmarks.latency.cases import DEFAULT, Case, workload
from benchmarks.latency.contenders import CONTENDERS, prepare
from benchmarks.latency.growth import grow
from benchmarks.latency.measure import Timing, interleave
from benchmarks.latency.rows import LatencyRow, compare, make_rows
from benchmarks.latency.sweeps import CONTENDERS as SWEPT
from benchmarks.latency.sweeps import SWEEPS
from edge_runtime.errors import PolicyError
from edge_runtime.policy.compiled_policy import load_kernel

RESULTS = Path(__file__).parents[1] / "results" / "latency"
ATTEMPTS = 3
SMALL = Case(layers=(128, 128))
Measured = TypeVar("Measured")


def main(arguments: Sequence[str]) -> int:
    """Returns 0; 1 if a budget is broken; 3 if the machine was not quiet, which proves nothing."""
    flags = _parse(arguments)
    if flags.loop:
        text, quiet = loop.measure(short=flags.short)
        print(text)
        return 0 if quiet else 3
    if flags.samplers:
        rows, noise = _samplers()
        if flags.json:
            write_result(flags.json, rows)
        return 3 if noise else 0
    if flags.kernel:
        return 3 if _kernel()[1] else 0
    if flags.actions or flags.jetson or flags.sixteen_bits:
        for line in _small_part(flags):
            print(line)
        return 0
    if flags.html:
        check_writable(flags.html)
    old = read_result(flags.compare, list[LatencyRow]) if flags.compare else []
    if flags.short:
        rows, code = run_short(load_budgets(), html=flags.html)
    else:
        rows, code = _run_full(flags.out, flags.html)
    if flags.json:
        write_result(flags.json, rows)
    for line in compare(old, rows):
        print(line)
    return code


def _small_part(flags: argparse.Namespace) -> Iterable[str]:
    if flags.actions:
        return actions.lines(actions.measure())
    return [orin_nano.describe() if flags.jetson else sixteen_bits.measure()]


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = make_parser("latency", __doc__)
    parser.add_argument("--short", action="store_true", help="the default case and its budgets only")
    parser.add_argument("--loop", action="store_true", help="the real loop from pose to command only")
    parser.add_argument("--actions", action="store_true", help="two, three and four action components only")
    parser.add_argument("--kernel", action="store_true", help="what the kernel takes over, and batches only")
    parser.add_argument("--samplers", action="store_true", help="samplers, their steps and modes only")
    parser.add_argument("--jetson", action="store_true", help="the estimate for a Jetson Orin Nano only")
    parser.add_argument(
        "--sixteen-bits", action="store_true", help="what weights of sixteen bits would bring only"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows there")
    parser.add_argument("--compare", type=Path, metavar="OLD", help="rows of an earlier run")
    parser.add_argument("--out", type=Path, default=RESULTS, metavar="DIR", help="for the page and pictures")
    add_html_flag(parser)
    return parser.parse_args(arguments)


def measure_case(case: Case, names: Sequence[str], rounds: int, slot_s: float) -> dict[str, Timing]:
    """Time contenders on a case beside the processor's limit."""
    timings = interleave(prepare(workload(case), names) | limit.probes(case), rounds, slot_s)
    return timings | {"limit": limit.limit(case, timings["peak"], timings["traffic"])}


def run_short(
    budgets: Sequence[Budget],
    case: Case = DEFAULT,
    rounds: int = 15,
    slot_s: float = 0.12,
    html: Path | None = None,
) -> tuple[list[LatencyRow], int]:
    """Time what the budgets name, and judge them; returns the exit code beside the rows."""
    named = {name for budget in budgets for name in (budget.backend, budget.against)}
    names = [name for name in CONTENDERS if name in named]
    timings, rows, noise = _quiet_case(case, names, rounds, slot_s)
    verdicts = judge(budgets, timings)
    print(*verdicts, sep="\n")
    _print_noise(noise)
    if html:
        write_page(make_page(page.render_short(case, rows, verdicts, noise)), html)
    return rows, _exit_code(verdicts, noise)


def _run_full(out: Path, html: Path | None) -> tuple[list[LatencyRow], int]:
    from benchmarks.latency import pictures  # noqa: PLC0415

    out.mkdir(parents=True, exist_ok=True)
    machine_now = machine.describe(_engine())
    timings, default, noise = _quiet_case(DEFAULT, list(CONTENDERS), rounds=30, slot_s=0.25)
    verdicts = judge(load_budgets(), timings)
    _, small, small_noise = _quiet_case(SMALL, list(CONTENDERS), rounds=15, slot_s=0.1)
    sampled, sampled_noise = _samplers()
    kernel, kernel_noise = _kernel()
    swept = [_quiet_case(case, SWEPT, rounds=5, slot_s=0.08) for case in _cases()]
    rows = [row for _, rows, _ in swept for row in rows]
    swept_noise = [reason for _, _, reasons in swept for reason in reasons]
    growths = [grow(sweep, rows, SWEPT) for sweep in SWEEPS]
    outcomes = [paced.measure(variant) for variant in paced.variants(["eager", "numpy", "compiled"], 5.0)]
    driven, quiet = loop.measure(short=False)
    driven_noise = [] if quiet else ["the real loop: its machine was disturbed, or a run failed"]
    result = page.Result(
        machine=machine_now,
        noise=[
            *noise,
            *small_noise,
            *sampled_noise,
            *kernel_noise,
            *swept_noise,
            *machine.wake_noise(machine_now),
            *driven_noise,
        ],
        default=default,
        loop=driven,
        verdicts=verdicts,
        small=small,
        sampled=sampled,
        kernel=kernel,
        growths=growths,
        paced=[row for row in outcomes if isinstance(row, LatencyRow)],
        refusals=sorted({text for text in outcomes if isinstance(text, str)}),
        footprints=[footprint.measure(backend) for backend in ("numpy", "compiled")],
        estimate="" if "Jetson" in machine_now.processor else orin_nano.describe(),
    )
    text = page.render(result)
    (out / "latency.md").write_text(text)
    for index, growth in enumerate(growths):
        pictures.draw_sweep(growth, out / f"sweep_{index}.png")
    pictures.draw_paced(result.paced, out / "paced.png")
    if html:
        write_page(make_page(text, out), html)
    print(text)
    return [*default, *small, *sampled, *rows, *result.paced], _exit_code(verdicts, result.noise)


def _samplers() -> tuple[list[LatencyRow], list[str]]:
    """Rows of samplers and modes, and why they must not be believed."""
    rows, noise = _until_quiet(samplers.measure)
    print(page.render_samplers(rows))
    _print_noise(noise)
    return rows, [f"samplers: {reason}" for reason in noise]


def _kernel() -> tuple[list[str], list[str]]:
    """Lines on what the kernel takes over, and why they must not be believed."""
    lines, noise = _until_quiet(native.measure)
    print(*lines, sep="\n")
    _print_noise(noise)
    return lines, [f"kernel: {reason}" for reason in noise]


def _until_quiet(measure: Callable[[], tuple[Measured, dict[str, Timing]]]) -> tuple[Measured, list[str]]:
    """What was measured, again while the machine is disturbed, and why it must not be believed."""
    for _ in range(ATTEMPTS):
        measured, timings = measure()
        noise = machine.noise(timings)
        if not noise:
            break
    return measured, noise


def _print_noise(noise: Sequence[str]) -> None:
    for reason in noise:
        print(f"INVALID, the machine is not quiet: {reason}")


def _exit_code(verdicts: Sequence[BudgetVerdict], noise: Sequence[str]) -> int:
    if noise:
        return 3
    return 0 if all(verdict.held for verdict in verdicts) else 1


def _cases() -> list[Case]:
    """Every case of the sweeps once."""
    return list(dict.fromkeys(sweep.make(value) for sweep in SWEEPS for value in sweep.values))


def _quiet_case(
    case: Case, names: Sequence[str], rounds: int, slot_s: float
) -> tuple[dict[str, Timing], list[LatencyRow], list[str]]:
    """Timings and rows of a case, and why they must not be believed."""

    def measure() -> tuple[dict[str, Timing], dict[str, Timing]]:
        timings = measure_case(case, names, rounds, slot_s)
        return timings, timings

    timings, noise = _until_quiet(measure)
    rows = _contender_rows(case, timings)
    _print_rows(case, rows)
    return timings, rows, [f"{case}: {reason}" for reason in noise]


def _contender_rows(case: Case, timings: dict[str, Timing]) -> list[LatencyRow]:
    """Rows of everything but the probes behind the limit."""
    return make_rows(case, {name: timing for name, timing in timings.items() if name not in limit.PROBES})


def _print_rows(case: Case, rows: Sequence[LatencyRow]) -> None:
    print(case)
    for row in rows:
        ratio = "" if row.ratio_to_eager is None else f"{row.ratio_to_eager:8.1f} x eager"
        print(
            f"  {row.backend:14} median {row.median_us:9.1f}  best {row.best_us:9.1f} us {ratio}", flush=True
        )


def _engine() -> str:
    try:
        return load_kernel().engines()[0]
    except PolicyError:
        return ""
