"""How the harness starts each robot: the very command that a user would type."""

from pathlib import Path

from edge_runtime.config.keys import operator_key, team_key
from edge_runtime.run.flags import make_mission, read_flags
from edge_runtime.tools.ctl.operator_link import OperatorLink
from firmware_bridge.kinematics.frames import rotate
from firmware_bridge.sil.scenario.ports import HOST
from firmware_bridge.sil.scenario.scenario import GUARD_PERIODS, Scenario, Station

MODULE = "edge_runtime.run"
STARTING_S = 120.0
"""Added to a robot's --duration: the harness ends it long before, when the run is over."""
LONGEST_GUARD_DEADLINE_S = 1.0
ANSWER_S = 0.25
"""How long the robots have to answer before the harness looks whether they live."""


def robot_arguments(scenario: Scenario, station: Station) -> list[str]:
    """Return edge-run's arguments for one robot."""
    request = scenario.request
    deadline_s = min(GUARD_PERIODS * scenario.period_s, LONGEST_GUARD_DEADLINE_S)
    arguments = {
        "--robot-id": station.robot_id,
        "--fleet": station.fleet_file,
        "--rate": request.rate_hz,
        "--duration": request.duration_s + STARTING_S,
        "--json": report_path(scenario, station.robot_id),
        "--log-dir": log_folder(scenario, station.robot_id),
        "--guard-deadline": deadline_s,
        "--seed": station.robot_id,
    }
    if request.policy is not None:
        arguments["--policy"] = request.policy
    arguments |= _link(scenario, station)
    words = [str(word) for pair in arguments.items() for word in pair]
    return [
        *words,
        *_pose(scenario, station),
        *[word for folder in request.ros_path for word in ("--ros-path", folder)],
        "--arm",
        "--stay",
        *(["--realtime"] if request.realtime else []),
    ]


def check_robot(scenario: Scenario, station: Station) -> None:
    """Check one robot's command as edge-run itself does before it opens anything.

    Raises:
        EdgeError: what edge-run would complain of.
    """
    flags, link = read_flags(robot_arguments(scenario, station))
    mission = make_mission(flags)
    link.make_spec(station.robot_id, mission.bundle.manifest, link.options_from(flags), mission.rate_hz)
    if scenario.fleet.carrier is not None:
        team_key(scenario.fleet)


def open_operator(scenario: Scenario) -> OperatorLink:
    """Return an operator's link to all robots; who answers it has a control loop that ticks."""
    ports = {station.robot_id: (HOST, station.port) for station in scenario.stations}
    return OperatorLink(ports, operator_key(scenario.fleet), ANSWER_S)


def probe_path(scenario: Scenario) -> Path:
    """Return where the wake-up probe's record goes."""
    return scenario.folder / "probe.record"


def report_path(scenario: Scenario, robot_id: int) -> Path:
    """Return where a robot's own report goes."""
    return scenario.folder / f"robot_{robot_id}.json"


def log_folder(scenario: Scenario, robot_id: int) -> Path:
    """Return where a robot's log goes: the user's folder, or one that goes away with the run."""
    return (scenario.request.log_dir or scenario.folder) / f"robot_{robot_id}"


def _link(scenario: Scenario, station: Station) -> dict[str, object]:
    bridge, vehicle = scenario.request.bridge, station.vehicle
    if bridge == "can":
        return {"--bridge": bridge, "--bus": station.wire, "--profile": vehicle.profile}
    if bridge == "mavlink":
        return {
            "--bridge": bridge,
            "--mavlink": f"udpout:{HOST}:{station.wire}",
            "--mavlink-autopilot": vehicle.profile,
            "--mavlink-point-ahead": vehicle.ahead_m,
        }
    return {"--bridge": bridge, "--ros-profile": vehicle.profile, "--ros-namespace": station.wire}


def _pose(scenario: Scenario, station: Station) -> list[str]:
    """CAN has no positions: the robot is told where its axle starts."""
    if scenario.request.bridge != "can":
        return []
    x, y, heading = axle(station)
    return ["--pose", f"{x:.6f}", f"{y:.6f}", f"{heading:.6f}"]


def axle(station: Station) -> tuple[float, float, float]:
    """Return x, y and heading of the axle of a robot whose disc is at its start."""
    back_x, back_y = rotate((station.vehicle.ahead_m, 0.0), station.heading_rad)
    return station.start_m[0] - back_x, station.start_m[1] - back_y, station.heading_rad
