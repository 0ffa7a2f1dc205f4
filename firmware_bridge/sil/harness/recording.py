"""What a run leaves behind, read back."""

from dataclasses import dataclass

import msgspec

from edge_runtime.run.run_report import RunReport
from firmware_bridge.sil.firmware.world_process import WorldRecord, record_path
from firmware_bridge.sil.harness.robots import log_folder, probe_path, report_path
from firmware_bridge.sil.measurement.robot_log import RobotLog, read_robot_log
from firmware_bridge.sil.measurement.wake_probe import ProbeRecord
from firmware_bridge.sil.report.records import ProcessCost
from firmware_bridge.sil.scenario.scenario import Scenario


@dataclass(frozen=True)
class Recording:
    """What a run left behind."""

    t0_s: float
    end_s: float
    world: WorldRecord
    probe: ProbeRecord
    reports: dict[int, RunReport]
    logs: dict[int, RobotLog]
    costs: tuple[ProcessCost, ...]
    others_cpu_cores: float
    done_s: dict[int, float]
    ended: tuple[str, ...]


def read_records(scenario: Scenario) -> tuple[WorldRecord, ProbeRecord]:
    """Return what plant and probe wrote.

    Raises:
        OSError: if one of them wrote nothing.
    """
    world, probe = record_path(scenario.folder / "world.json"), probe_path(scenario)
    return (
        msgspec.msgpack.decode(world.read_bytes(), type=WorldRecord),
        msgspec.msgpack.decode(probe.read_bytes(), type=ProbeRecord),
    )


def read_reports(scenario: Scenario) -> dict[int, RunReport]:
    """Return the robots' own reports by id, of those that came to write one."""
    reports = {}
    for station in scenario.stations:
        path = report_path(scenario, station.robot_id)
        if path.is_file() and path.stat().st_size:
            reports[station.robot_id] = msgspec.json.decode(path.read_bytes(), type=RunReport)
    return reports


def read_logs(scenario: Scenario) -> dict[int, RobotLog]:
    """Return the robots' logs by id."""
    robots = [station.robot_id for station in scenario.stations]
    return {robot_id: read_robot_log(log_folder(scenario, robot_id)) for robot_id in robots}
