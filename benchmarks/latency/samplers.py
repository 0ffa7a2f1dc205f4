"""Samplers and their steps, with and without steering along the flow, beside the research code's ten steps.

At equal T, all take ten; at equal success, as many as the packaged policies, which succeed as often in them
(`python -m benchmarks samplers`).
"""

from collections.abc import Mapping, Sequence

from benchmarks.latency import limit
from benchmarks.latency.cases import DEFAULT, Case, workload
from benchmarks.latency.contenders import CONTENDERS
from benchmarks.latency.measure import Timing, interleave
from benchmarks.latency.rows import LatencyRow, make_row
from edge_runtime.policy.bundle import PACKAGED, load_bundle

BACKENDS = ("numpy", "compiled")


def cases() -> list[Case]:
    """What is timed on each backend, the default case first."""
    packaged = sorted({load_bundle(path.parent).manifest.steps for path in PACKAGED.glob("*/manifest.json")})
    exponential = [Case(sampler="exponential", steps=steps) for steps in (DEFAULT.steps, *packaged)]
    alone = [Case(sampler="exponential", steps=steps, mode="correction") for steps in packaged]
    return list(dict.fromkeys([DEFAULT, *exponential, *alone]))


def measure(
    rounds: int = 30, slot_s: float = 0.1, timed: Sequence[Case] = ()
) -> tuple[list[LatencyRow], dict[str, Timing]]:
    """Time every case beside eager PyTorch's default one and the processor's limit, in one interleaved run.

    Returns:
        Rows with their ratio to that one, and the timings that tell whether the machine was quiet.
    """
    timed = timed or cases()
    ticks = {"eager": CONTENDERS["eager"](workload(timed[0]))}
    for case in timed:
        ticks |= {f"{name} {case}": CONTENDERS[name](workload(case)) for name in BACKENDS}
        ticks |= {f"{name} {case}": probe for name, probe in limit.probes(case).items()}
    timings = interleave(ticks, rounds, slot_s)
    return list(_rows(timed, timings)), timings | {"peak": timings[f"peak {timed[0]}"]}


def _rows(timed: Sequence[Case], timings: Mapping[str, Timing]) -> list[LatencyRow]:
    eager = timings["eager"]
    rows = [make_row("eager", timed[0], eager, eager)]
    for case in timed:
        least = limit.limit(case, timings[f"peak {case}"], timings[f"traffic {case}"])
        rows += [make_row(name, case, timings[f"{name} {case}"], eager) for name in BACKENDS]
        rows.append(make_row("limit", case, least, eager))
    return rows
