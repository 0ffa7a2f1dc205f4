"""From what a run left behind to its report: figures per robot and for the team, then the verdict."""

import os
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.control.rate import Percentiles
from firmware_bridge.sil.firmware.record import NodeRecord
from firmware_bridge.sil.firmware.truth import ObjectOutcome
from firmware_bridge.sil.harness.recording import Recording
from firmware_bridge.sil.judge.figures import (
    LoggedTicks,
    halts,
    miss_counts,
    missed_bursts,
    percentiles,
    pose_ages,
)
from firmware_bridge.sil.judge.verdict import broken_limits, disturbances
from firmware_bridge.sil.report.records import (
    FaultDone,
    MachineQuality,
    ObjectQuality,
    Quality,
    RobotQuality,
    SilReport,
)
from firmware_bridge.sil.scenario.faults import Lasting
from firmware_bridge.sil.scenario.scenario import Scenario

POSE_TOLERANCE_S = {"can": 0.0, "mavlink": 0.002, "ros1": 0.0, "ros2": 0.0}
"""How far a runtime's stamp may lie before the measurement: MAVLink counts milliseconds."""


class Timing(msgspec.Struct, frozen=True):
    """What comes from arrivals alone, of one robot, or of several: the least rate, the sum of misses."""

    share: float
    jitter_ms: Percentiles | None
    misses: int
    longest_burst: int


def judge(scenario: Scenario, recording: Recording) -> SilReport:
    """Sum up a run."""
    robots = tuple(_robot(scenario, recording, index) for index in range(len(scenario.stations)))
    machine = _machine(scenario, recording)
    report = SilReport(
        bridge=scenario.request.bridge,
        robots_count=len(robots),
        rate_hz=scenario.request.rate_hz,
        duration_s=recording.end_s - recording.t0_s,
        policy=scenario.bundle.manifest.name,
        robots=robots,
        team=_team(scenario, recording, robots),
        processes=recording.costs,
        machine=machine,
        faults=_faults(scenario, recording),
        ended=recording.ended,
        broken=(),
        disturbed=disturbances(machine, scenario.limits.machine),
        verdict="passed",
        objects=tuple(_object(each, scenario.fleet.team.arrival_m) for each in recording.world.objects),
    )
    broken = broken_limits(report, scenario.limits.run)
    verdict = "invalid" if report.disturbed else "failed" if broken else "passed"
    return msgspec.structs.replace(report, broken=broken, verdict=verdict)


def _object(outcome: ObjectOutcome, arrival_m: float) -> ObjectQuality:
    away_m, least_m = outcome.goal_distance_m, outcome.least_goal_distance_m
    return ObjectQuality(outcome.name, away_m, least_m, goal_reached=least_m <= arrival_m)


def _robot(scenario: Scenario, recording: Recording, index: int) -> RobotQuality:
    node, outcome = recording.world.nodes[index], recording.world.outcomes[index]
    robot_id, period_s = node.robot_id, scenario.period_s
    runtime = recording.reports.get(robot_id)
    fleet = runtime.fleet if runtime else None
    log = recording.logs[robot_id]
    timing = timing_of([node], recording, period_s)
    speed = np.hypot(np.hypot(node.forward_m_s, node.lateral_m_s), node.yaw_rad_s)
    window = (period_s, recording.t0_s, recording.end_s)
    ticks = LoggedTicks(log.due_s, log.decided_s, log.misses)
    counts = miss_counts(np.array(node.command_s), ticks, *window)
    own = [cost for cost in recording.costs if cost.name.partition("/")[0] == f"robot_{robot_id}"]
    return RobotQuality(
        achieved_rate_hz=timing.share / period_s,
        achieved_rate_share=timing.share,
        period_jitter_ms=timing.jitter_ms,
        deadline_misses=timing.misses,
        longest_burst=timing.longest_burst,
        pose_to_command_age_ms=percentiles(_pose_ages(scenario, recording, node), 1e3),
        fleet_message_age_ms=percentiles(log.message_ages_s(recording.t0_s, recording.end_s), 1e3),
        fleet_used_age_ms=percentiles(log.state_ages_s(recording.t0_s, recording.end_s), 1e3),
        objective_violations_share=outcome.violated_s / (recording.end_s - recording.t0_s),
        collisions=outcome.collisions,
        goals_reached=int(
            outcome.goal_distance_m is not None and outcome.goal_distance_m <= scenario.fleet.team.arrival_m
        ),
        cpu_cores=sum(cost.cpu_cores for cost in own),
        memory_mib=sum(cost.memory_mib for cost in own),
        robot_id=robot_id,
        exempt=any(robot_id in fault.hits for fault in scenario.faults),
        stop_reason=runtime.stop_reason if runtime else "",
        undecided_ticks=int(missed_bursts(log.decided_s, *window).sum()),
        runtime_misses=runtime.deadline_misses if runtime else None,
        lacking_commands=counts.lacking if counts else None,
        counted_misses=counts.counted if counts else None,
        late_commands=counts.late if counts else None,
        stopped_ticks=runtime.faults if runtime else {},
        refused_messages=fleet.refused if fleet else {},
        accepted_messages=fleet.accepted if fleet else 0,
        sent_messages=fleet.sent if fleet else 0,
        driven_s=runtime.ticks / runtime.rate_hz if runtime and runtime.rate_hz else 0.0,
        log_gaps_s=tuple(
            (begin_s - recording.t0_s, end_s - recording.t0_s)
            for begin_s, end_s in log.gaps_s(recording.t0_s, recording.end_s, 3.0 * period_s)
        ),
        objective_changes_s=tuple((at_s - recording.t0_s, version) for at_s, version in log.changes_s()),
        halts_s=halts(np.array(node.command_s), speed, *window),
        tick_us=runtime.tick_us if runtime else None,
        stage_us=runtime.stage_us if runtime else {},
        goal_distance_m=outcome.goal_distance_m,
        least_distance_m=outcome.least_distance_m,
        greatest_speed_m_s=outcome.greatest_speed_m_s,
        firmware_timeouts=node.timeouts,
        obstacle_contacts=outcome.obstacle_contacts,
    )


def _team(scenario: Scenario, recording: Recording, robots: Sequence[RobotQuality]) -> Quality:
    driving = {robot.robot_id for robot in robots if not robot.exempt}
    nodes = [node for node in recording.world.nodes if node.robot_id in driving or not driving]
    timing = timing_of(nodes, recording, scenario.period_s)
    ages = [_pose_ages(scenario, recording, node) for node in nodes]
    return Quality(
        achieved_rate_hz=timing.share / scenario.period_s,
        achieved_rate_share=timing.share,
        period_jitter_ms=timing.jitter_ms,
        deadline_misses=timing.misses,
        longest_burst=timing.longest_burst,
        pose_to_command_age_ms=percentiles(np.concatenate(ages), 1e3),
        fleet_message_age_ms=_worst(robot.fleet_message_age_ms for robot in robots),
        fleet_used_age_ms=_worst(robot.fleet_used_age_ms for robot in robots),
        objective_violations_share=float(np.mean([robot.objective_violations_share for robot in robots])),
        collisions=sum(robot.collisions for robot in robots) // 2
        + sum(robot.obstacle_contacts for robot in robots),
        goals_reached=sum(robot.goals_reached for robot in robots),
        cpu_cores=sum(cost.cpu_cores for cost in recording.costs),
        memory_mib=sum(cost.memory_mib for cost in recording.costs),
    )


def timing_of(nodes: Sequence[NodeRecord], recording: Recording, period_s: float) -> Timing:
    """Return what the arrivals at these firmwares say."""
    begin_s, end_s = recording.t0_s, recording.end_s
    whole = max(round((end_s - begin_s) / period_s), 1)
    bursts, jitter_s = [], []
    for node in nodes:
        arrival_s = np.array(node.command_s)
        bursts.append(missed_bursts(arrival_s, period_s, begin_s, end_s))
        inside = arrival_s[(arrival_s >= begin_s) & (arrival_s < end_s)]
        jitter_s.append(np.abs(np.diff(inside) - period_s))
    every = np.concatenate(bursts)
    share = 1.0 - max(int(burst.sum()) for burst in bursts) / whole
    jitter_ms = percentiles(np.concatenate(jitter_s), 1e3)
    return Timing(share, jitter_ms, int(every.sum()), int(every.max(initial=0)))


def _pose_ages(scenario: Scenario, recording: Recording, node: NodeRecord) -> Floats:
    log = recording.logs[node.robot_id]
    arrival_s = np.array(node.command_s)
    inside = arrival_s[(arrival_s >= recording.t0_s) & (arrival_s < recording.end_s)]
    tolerance_s = POSE_TOLERANCE_S[scenario.request.bridge]
    measured_s, used_s = np.array(node.pose_s), log.used_pose_s
    if node.pose_x_m:
        # Its stamp is the older one of pose and wheels; what it acted on is that pose.
        by_place = dict(zip(node.pose_x_m, node.pose_s, strict=True))
        used_s = np.array([by_place.get(x_m, -np.inf) for x_m in log.used_x_m.tolist()])
        tolerance_s = 0.0
    return pose_ages(inside, log.decided_s, used_s, measured_s, tolerance_s)


def _worst(every: Iterable[Percentiles | None]) -> Percentiles | None:
    known = [one for one in every if one is not None]
    return max(known, key=lambda one: one.p99, default=None)


def _machine(scenario: Scenario, recording: Recording) -> MachineQuality:
    time_s, late_s = np.array(recording.probe.time_s), np.array(recording.probe.late_s)
    beside = late_s[(time_s >= recording.t0_s) & (time_s < recording.end_s)]
    return MachineQuality(
        cores=len(os.sched_getaffinity(0)),
        realtime=scenario.request.realtime,
        wake_ms=percentiles(beside, 1e3),
        plant_late_ms=percentiles(recording.world.late_s, 1e3),
        others_cpu_cores=recording.others_cpu_cores,
    )


def _faults(scenario: Scenario, recording: Recording) -> tuple[FaultDone, ...]:
    return tuple(
        FaultDone(
            kind=fault.kind,
            at_s=fault.at_s,
            for_s=fault.for_s if isinstance(fault, Lasting) else None,
            details=msgspec.json.encode(fault).decode(),
            done_s=recording.done_s.get(index),
            stops=recording.world.stops[index],
        )
        for index, fault in enumerate(scenario.faults)
    )
