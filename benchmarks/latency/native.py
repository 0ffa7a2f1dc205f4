"""What the compiled kernel takes over: a task's objectives, those of one's own, batches in one call."""

from collections.abc import Iterator

import numpy as np

from benchmarks.latency import limit
from benchmarks.latency.cases import Case, workload
from benchmarks.latency.contenders import CONTENDERS, Tick
from benchmarks.latency.measure import Timing, interleave
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import guide_for
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.objectives import Clustering, Geofence, SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import packaged_bundle

BATCHES = (8, 64)
"""A team, and its samples."""
SAMPLING = (
    Geofence(centre_m=(0.0, 0.0), radius_m=0.3),
    Clustering(radius_m=0.2),
    SafetyMargin(distance_m=0.25),
    SpeedLimit(limit_m_s=0.3),
)
"""What Sampling's robots are asked at most; all of it steers at the states below."""


def measure(rounds: int = 40, slot_s: float = 0.05) -> tuple[list[str], dict[str, Timing]]:
    """Time all of it in one interleaved run.

    Returns:
        A line for each comparison, of processor time in the same round, and the timings that tell whether
        the machine was quiet.
    """
    ticks: dict[str, Tick] = {f"sampling {name}": _sampling(name) for name in ("numpy", "compiled")}
    single = workload(Case())
    ticks |= {name: CONTENDERS[name](single) for name in ("numpy", "compiled-own", "compiled")}
    ticks |= {f"batch {size}": CONTENDERS["compiled"](workload(Case(batch=size))) for size in BATCHES}
    timings = interleave(ticks | {"peak": limit.probes(Case())["peak"]}, rounds, slot_s)
    return list(_lines(timings)), timings


def _lines(timings: dict[str, Timing]) -> Iterator[str]:
    yield _line("Sampling's fence, cluster, margin and speed", timings, "sampling compiled", "sampling numpy")
    yield _line("both objectives of one's own in Python", timings, "compiled-own", "numpy")
    yield _line("both objectives in the kernel", timings, "compiled", "numpy")
    for size in BATCHES:
        timing = timings[f"batch {size}"]
        share = 1.0 / (size * timing.times_faster_than(timings["compiled"]))
        yield f"batch of {size}: {timing.best_us:.1f} us at best, {share:.2f} times {size} single ticks"


def _line(what: str, timings: dict[str, Timing], name: str, against: str) -> str:
    timing, other = timings[name], timings[against]
    faster, best = timing.times_faster_than(other), f"{timing.best_us:.1f} us at best"
    return f"{what}: {best}, numpy {other.best_us:.1f} us: {faster:.1f} times as fast"


def _sampling(backend: str) -> Tick:
    """A tick of a robot inside the fence, too fast and too near its two teammates."""
    bundle = packaged_bundle("sampling")
    policy = bundle.field("numpy" if backend == "numpy" else "compiled")
    guide = guide_for(bundle.manifest, ObjectiveSet(SAMPLING, GuidanceSettings(scale=0.3, reach=2.0)))
    draw = np.random.default_rng(0)
    observation = draw.standard_normal((1, policy.observation_dim)).astype(np.float32)
    mates = [Teammate(RobotState(n, 0.0, (0.1 * n, 0.1), (-0.2, 0.1)), (0.1, -0.2)) for n in (1, 2)]
    team = TeamState(RobotState(0, 0.0, (0.05, 0.0), (0.3, 0.2)), tuple(mates))
    return lambda: np.array([guided_action(policy, observation, team, guide).action])
