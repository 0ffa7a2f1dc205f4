"""What training will take: how much before it begins, how long as soon as runs tell."""

import csv
from collections.abc import Sequence
from pathlib import Path

from export.schedule.job import Job
from export.training.checkpoint import CHECKPOINT

RUN_BYTES = 2_000_000
"""What a finished run takes on the disk, about."""


def cost(jobs: Sequence[Job], at_once: int) -> str:
    """Tell how many frames are left, and about how long that takes if so many are trained at once.

    Machines and tasks differ too much to assume a speed: it is that of runs of the same task and algorithm.
    """
    frames = sum(_left(job) for job in jobs)
    space = sum(RUN_BYTES for job in jobs if not (job.directory / CHECKPOINT).exists())
    rates = {job: _rate(job) for job in jobs}
    seconds = sum(_left(job) / rate for job, rate in rates.items() if rate)
    unknown = sum(rate is None for rate in rates.values())
    told = f"{len(jobs)} to train: {frames / 1e6:.1f} million frames, {space / 1e6:.0f} MB"
    if seconds:
        elapsed = seconds / min(at_once, len(jobs))
        told += f", {_duration(seconds)} of one core, about {_duration(elapsed)} with {at_once} at once"
    if unknown:
        told += f"; the time of {unknown} is not known yet: the first run of a task and algorithm tells it"
    return told


def _duration(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.0f} min"


def _left(job: Job) -> int:
    row = _last_row(job.directory)
    return max(job.frames - int(row["frames"]), 0) if row else job.frames


def _rate(job: Job) -> float | None:
    """Frames in a second of its own run, or of another seed's."""
    for directory in (job.directory, *sorted(job.directory.parent.glob("seed-*"))):
        row = _last_row(directory)
        if row and float(row["seconds"]) > 0.0:
            return float(row["frames"]) / float(row["seconds"])
    return None


def _last_row(directory: Path) -> dict[str, str] | None:
    try:
        with (directory / "metrics.csv").open(newline="") as file:
            return list(csv.DictReader(file))[-1]
    except (FileNotFoundError, IndexError):
        return None
