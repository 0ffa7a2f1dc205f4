"""What the numpy runtime costs a robot before its first action: resident memory and start-up time."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.latency.cases import Case, workload

FIRST_ACTION = """
import sys, numpy as np
from edge_runtime.policy.backend import make_policy
from edge_runtime.motion.point import PointForce
from edge_runtime.guidance.flow import guided_action
from edge_runtime.guidance.guide import make_guide
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.weights import FlowWeights

stored = np.load(sys.argv[1])
weights = FlowWeights(
    activation="silu", prior_std=0.5,
    **{name: stored[name] for name in ("action", "observation", "time", "time_frequency", "time_phase")},
    matrices=tuple(stored[f"matrix{i}"] for i in range(3)),
    biases=tuple(stored[f"bias{i}"] for i in range(4)),
)
policy = make_policy(weights, 10, backend=sys.argv[2])
asked = ObjectiveSet((SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25)))
guide = make_guide(asked, PointForce(1.0, 0.25, 0.1, 2))
team = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.1, 0.0)))
guided_action(policy, np.zeros((1, 32), np.float32), team, guide)
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(float(status["VmHWM"].split()[0]) / 1024)
"""


class Footprint(msgspec.Struct, frozen=True):
    """One backend's cost at start, the median of some starts."""

    backend: str
    resident_mib: float
    first_action_ms: float
    """From the process's start to its end, right after the first action."""


def measure(backend: str, starts: int = 5) -> Footprint:
    """Start a process that loads a 3x256 network from a file and samples one action."""
    weights = workload(Case()).weights
    arrays = {
        n: getattr(weights, n) for n in ("action", "observation", "time", "time_frequency", "time_phase")
    }
    arrays |= {f"matrix{i}": matrix for i, matrix in enumerate(weights.matrices)}
    arrays |= {f"bias{i}": bias for i, bias in enumerate(weights.biases)}
    durations, sizes = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "weights.npz"
        np.savez(path, **arrays)
        for _ in range(starts):
            begin = time.perf_counter()
            command = [sys.executable, "-c", FIRST_ACTION, str(path), backend]
            done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
            durations.append(1e3 * (time.perf_counter() - begin))
            sizes.append(float(done.stdout))
    return Footprint(backend, float(np.median(sizes)), float(np.median(durations)))
