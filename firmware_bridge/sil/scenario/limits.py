"""What a run must keep, and what its machine must: the file of ``--limits``."""

import math
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.toml_file import read_toml, refuse, to_record

DEFAULT_LIMITS: Final = Path(__file__).with_name("limits.toml")


class _Positive(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"`{field}` must not be negative, got {value:g}")


class RunLimits(_Positive, frozen=True, forbid_unknown_fields=True):
    """What every robot must keep that no fault took out; what is left out is not judged."""

    achieved_rate_share: float | None = None
    """Least share of the ticks that reach the firmware as commands."""
    longest_burst: int | None = None
    """Most deadlines missed in a row."""
    uncounted_misses: int | None = None
    """How far a loop's count of missed deadlines may be from the commands that its firmware lacked."""
    pose_to_command_age_periods: float | None = None
    """p99, in control periods."""
    fleet_message_age_periods: float | None = None
    """p99, in control periods."""
    objective_violation_share: float | None = None
    """Greatest share of the time in which any objective is broken."""
    collisions: int | None = None
    """Of the whole team, with the robots that a fault took out."""
    goals_reached_share: float | None = None
    """Of the robots that no fault took out."""
    memory_growth_mib: float | None = None
    """Of each process."""


class MachineLimits(_Positive, frozen=True, forbid_unknown_fields=True):
    """Beyond these a run proves nothing: other processes or the hypervisor disturbed it."""

    wake_p99_ms: float | None = None
    """Lateness of a sleeping process beside the run."""
    others_cpu_cores: float | None = None
    """Processor time that processes other than the run's took, and that the hypervisor stole, in cores."""


class LimitsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A limits file."""

    run: RunLimits = RunLimits()
    machine: MachineLimits = MachineLimits()


def load_limits(path: Path = DEFAULT_LIMITS) -> LimitsFile:
    """Read a limits file: ``[run]`` and ``[machine]``.

    Raises:
        ConfigError: names the file, the key and what is allowed; also if it judges nothing.
    """
    limits = to_record(read_toml(path), LimitsFile, path)
    if limits.run == RunLimits():
        allowed = ", ".join(RunLimits.__struct_fields__)
        refuse(path, "run", f"names no limit, so nothing could fail; allowed: {allowed}")
    return limits
