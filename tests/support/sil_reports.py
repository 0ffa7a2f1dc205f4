"""Reports of runs in the loop, as a test wants them."""

from edge_runtime.control.rate import Percentiles
from firmware_bridge.sil.report.records import (
    Evidence,
    MachineQuality,
    Quality,
    RobotQuality,
    SilReport,
)

EVIDENCE = Evidence(
    started_at="2026-03-14T09:26:53Z",
    command=("edge-sil", "--faults", "my faults.toml"),
    version="0.1.0",
    commit="f" * 40,
    python="3.11.2",
    numpy="2.4.0",
    machine="bench, two cores",
    sha256={"policy": "a" * 64, "limits": "b" * 64},
    limits={"run.collisions": 0, "machine.wake_p99_ms": 5.0},
)
AGES = Percentiles(5.0, 15.0, 18.0, 19.0)


QUALITY = {
    "achieved_rate_hz": 50.0,
    "achieved_rate_share": 1.0,
    "period_jitter_ms": AGES,
    "deadline_misses": 0,
    "longest_burst": 0,
    "pose_to_command_age_ms": AGES,
    "fleet_message_age_ms": AGES,
    "fleet_used_age_ms": AGES,
    "objective_violations_share": 0.0,
    "collisions": 0,
    "goals_reached": 1,
    "cpu_cores": 0.1,
    "memory_mib": 80.0,
}


LENIENT = "[run]\ncollisions = 1000000\n[machine]\n"
"""A limits file that no run breaks, however busy the machine."""

MACHINE = MachineQuality(
    cores=2,
    realtime=True,
    wake_ms=Percentiles(0.1, 0.5, 0.6, 0.7),
    plant_late_ms=None,
    others_cpu_cores=0.0,
)


def unstarved(outcome):
    """A process of edge-sil and its report; None where a busy machine let a guard's deadline pass."""
    _, told = outcome
    return None if told and any("no fresh command" in why for why in told["ended"]) else outcome


def robot(robot_id=0, **changes):
    return RobotQuality(
        **{
            **QUALITY,
            "robot_id": robot_id,
            "exempt": False,
            "stop_reason": "SIGTERM",
            "undecided_ticks": 0,
            "runtime_misses": 0,
            "stopped_ticks": {},
            "refused_messages": {},
            "accepted_messages": 100,
            "sent_messages": 100,
            "driven_s": 30.0,
            "log_gaps_s": (),
            "objective_changes_s": (),
            "halts_s": (),
            "goal_distance_m": 0.05,
            "least_distance_m": 0.3,
            "greatest_speed_m_s": 0.3,
            "firmware_timeouts": 0,
            **changes,
        }
    )


def report(*robots, **changes):
    fields = {
        "bridge": "can",
        "robots_count": len(robots),
        "rate_hz": 50.0,
        "duration_s": 30.0,
        "policy": "navigation",
        "robots": robots,
        "team": Quality(**{**QUALITY, "collisions": sum(one.collisions for one in robots) // 2}),
        "processes": (),
        "machine": MACHINE,
        "faults": (),
        "ended": (),
        "broken": (),
        "disturbed": (),
        "verdict": "passed",
        "evidence": EVIDENCE,
        **changes,
    }
    return SilReport(**fields)
