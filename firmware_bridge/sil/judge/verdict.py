"""Judges a report by its limits; every complaint is one line."""

from collections.abc import Iterator

from firmware_bridge.sil.report.records import MachineQuality, RobotQuality, SilReport
from firmware_bridge.sil.scenario.limits import MachineLimits, RunLimits


def disturbances(machine: MachineQuality, limits: MachineLimits) -> tuple[str, ...]:
    """Return why the machine was not quiet enough; empty for a quiet one."""
    reasons = []
    wake, longest_ms = machine.wake_ms, limits.wake_p99_ms
    if longest_ms is not None and (wake is None or wake.p99 > longest_ms):
        said = "never" if wake is None else f"{wake.p99:.2f} ms late at p99"
        reasons.append(f"a sleeping process woke {said}, {longest_ms:g} ms allowed")
    most = limits.others_cpu_cores
    if most is not None and machine.others_cpu_cores > most:
        reasons.append(f"others took {machine.others_cpu_cores:.2f} cores, {most:g} allowed")
    return tuple(reasons)


def broken_limits(report: SilReport, limits: RunLimits) -> tuple[str, ...]:
    """Return what was not kept; empty if everything was."""
    judged = [robot for robot in report.robots if not robot.exempt]
    lines = list(report.ended)
    for robot in judged:
        complaints = (*_timing(robot, limits), *_ages(robot, limits, 1e3 / report.rate_hz))
        lines += [f"robot {robot.robot_id}: {complaint}" for complaint in complaints]
    lines += _team(report, judged, limits)
    lines += _memory(report, limits)
    return tuple(lines)


def _timing(robot: RobotQuality, limits: RunLimits) -> Iterator[str]:
    least, longest = limits.achieved_rate_share, limits.longest_burst
    if least is not None and robot.achieved_rate_share < least:
        yield f"{robot.achieved_rate_share:.2%} of the ticks, {least:.2%} needed"
    if longest is not None and robot.longest_burst > longest:
        yield f"{robot.longest_burst} deadlines missed in a row, {longest} allowed"
    most, lacking, counted = limits.uncounted_misses, robot.lacking_commands, robot.counted_misses
    if most is not None and lacking is not None and counted is not None and abs(lacking - counted) > most:
        yield f"its firmware lacked {lacking} commands, its loop counted {counted} misses"
    share = limits.objective_violation_share
    if share is not None and robot.objective_violations_share > share:
        yield f"objectives broken {robot.objective_violations_share:.1%} of the time, {share:.1%} allowed"


def _ages(robot: RobotQuality, limits: RunLimits, period_ms: float) -> Iterator[str]:
    for what, age, periods in (
        ("pose to command", robot.pose_to_command_age_ms, limits.pose_to_command_age_periods),
        ("fleet message", robot.fleet_message_age_ms, limits.fleet_message_age_periods),
    ):
        if periods is not None and age is not None and age.p99 > periods * period_ms:
            yield f"{what} age {age.p99:.1f} ms at p99, {periods * period_ms:.1f} ms allowed"


def _team(report: SilReport, judged: list[RobotQuality], limits: RunLimits) -> Iterator[str]:
    if limits.collisions is not None and report.team.collisions > limits.collisions:
        yield f"{report.team.collisions} collisions, {limits.collisions} allowed"
    going = [(robot, robot.goal_distance_m) for robot in judged if robot.goal_distance_m is not None]
    reached = sum(robot.goals_reached for robot, _ in going)
    least = limits.goals_reached_share
    if least is not None and reached < least * len(going):
        away = ", ".join(f"robot {r.robot_id} {away_m:.2f} m" for r, away_m in going if not r.goals_reached)
        yield f"{reached} of {len(going)} goals reached ({away} away)"
    for each in report.objects if least is not None else ():
        if not each.goal_reached:
            yield f"{each.name} came no nearer than {each.least_goal_distance_m:.2f} m to its goal"


def _memory(report: SilReport, limits: RunLimits) -> Iterator[str]:
    most = limits.memory_growth_mib
    for process in report.processes if most is not None else ():
        if most is not None and process.memory_growth_mib > most:
            yield f"{process.name} grew by {process.memory_growth_mib:.1f} MiB, {most:g} MiB allowed"
