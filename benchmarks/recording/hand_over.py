"""What the loop itself spends on handing a tick to its logger."""

import tempfile
import time

import numpy as np

from benchmarks.recording.rows import HandOver
from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.policy.bundle import packaged_bundle
from edge_runtime.recording.folder import run_name
from edge_runtime.recording.recorder import Recorder
from edge_runtime.recording.wire import LogPlan
from edge_runtime.run.loop import STAGES


def measure_hand_over(rate: float, duration: float) -> HandOver:
    """Time `Recorder.follow` in a paced loop with a real logger."""
    fleet = load_fleet(DEFAULT_FLEET)
    mission = Mission(0, fleet, packaged_bundle("navigation"), fleet.objective_set, rate)
    controller = mission.controller(0)
    grid, timing, spent = DeadlineGrid(1.0 / rate), TimingRecord(STAGES), []
    mates = tuple(Teammate(RobotState(i, 0.0, (float(i), 0.5), (0.1, 0.2))) for i in (1, 2, 3))
    with tempfile.TemporaryDirectory() as folder:
        plan = LogPlan(folder, run_name(1, "20260101T000000Z", 0, 0), 10**8, 600.0, 10**9)
        with Recorder(plan) as recorder:
            recorder.begin(mission, controller, grid, timing, bridge="none", dry_run=True)
            while grid.next_s < duration:
                deadline_s = grid.wait()
                timing.begin(deadline_s)
                team = TeamState(RobotState(0, time.monotonic(), (0.0, 0.0), (0.1, 0.2)), mates)
                observation = controller.observe(team)
                guided = controller.act(observation, team)
                command = controller.limit(guided, team, time.monotonic())
                for _ in STAGES:
                    timing.lap()
                timing.end()
                begin = time.perf_counter()
                recorder.record(deadline_s, team, observation, guided, command)
                spent.append(1e6 * (time.perf_counter() - begin))
            recorder.end("duration", failed=False)
    p50, p99 = np.percentile(spent[10:], [50.0, 99.0]).tolist()
    return HandOver(rate, p50, p99, max(spent[10:]))
