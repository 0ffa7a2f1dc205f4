"""``python -m benchmarks NAME``: every measurement by its name, imported only when it is run."""

import importlib
import sys
from collections.abc import Sequence

from edge_runtime.common.command_line import command

COMMANDS = {
    "ablation": "benchmarks.paper.ablation.ablation_command",
    "calibration": "benchmarks.paper.calibration",
    "curves": "benchmarks.paper.curves",
    "failsafe": "benchmarks.faults.failsafe",
    "faults": "benchmarks.faults.faults_command",
    "husky": "benchmarks.husky.husky_command",
    "husky-pictures": "benchmarks.husky.pictures",
    "husky-ros": "benchmarks.husky.through_ros",
    "latency": "benchmarks.latency.latency_command",
    "layout": "benchmarks.layout",
    "modes": "benchmarks.paper.modes.modes_command",
    "obstacles": "benchmarks.obstacles.obstacles_command",
    "oracle": "benchmarks.paper.oracle.oracle_command",
    "page": "benchmarks.common.result_page",
    "paper": "benchmarks.paper.paper_command",
    "peers": "benchmarks.faults.peers",
    "pictures": "benchmarks.pictures",
    "rate": "benchmarks.rate",
    "recording": "benchmarks.recording.recording_command",
    "samplers": "benchmarks.paper.samplers.samplers_command",
    "sil": "benchmarks.sil.sil_command",
    "stills": "benchmarks.stills",
    "steering": "benchmarks.paper.steering.steering_command",
    "tasks": "benchmarks.paper.driven",
    "team_size": "benchmarks.paper.team_size.team_size_command",
    "values": "benchmarks.paper.values_command",
}


def main() -> int:
    """Run one measurement; returns its exit code."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in COMMANDS:
        print(f"usage: python -m benchmarks {{{','.join(COMMANDS)}}} ...", file=sys.stderr)
        return 2

    @command(f"benchmarks {name}")
    def measure(arguments: Sequence[str]) -> int:
        return importlib.import_module(COMMANDS[name]).main(arguments)

    return measure(sys.argv[2:])


if __name__ == "__main__":
    sys.exit(main())
