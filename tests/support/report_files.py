"""A short recorded run of a team in one process, made once."""

import subprocess
import sys

from bundles import write_straight_bundle

FLEET = """
[[robots]]
id = 0
start_m = [0.0, 0.0]
goal_m = [0.3, 0.0]
[[robots]]
id = 5
start_m = [0.0, 0.6]
goal_m = [0.3, 0.6]
[[objectives]]
type = "speed_limit"
limit_m_s = 0.3
[[objectives]]
type = "safety_margin"
distance_m = 0.25
[[objectives]]
type = "geofence"
centre_m = [2.0, 2.0]
radius_m = 0.5
"""


def record(folder, *flags):
    """Run for four seconds at 50 Hz; returns the log."""
    bundle = write_straight_bundle(folder / "straight")
    (folder / "fleet.toml").write_text(FLEET)
    command = [sys.executable, "-m", "edge_runtime.run", "--robot-id", "0", "--policy", bundle, "--stay"]
    command += [
        "--fleet",
        folder / "fleet.toml",
        "--rate",
        "50",
        "--duration",
        "4",
        "--log-dir",
        folder,
        *flags,
    ]
    subprocess.run(command, check=True, capture_output=True)
    (log,) = folder.glob("*.mcap")
    return log
