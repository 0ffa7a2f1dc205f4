"""What training will take, before it begins."""

import csv
from collections.abc import Sequence
from pathlib import Path

from export.schedule.job import Job
from export.training.checkpoint import CHECKPOINT

FRAMES_PER_S = {"mappo": 8_000, "pc-mappo": 7_000, "mafpo": 4_000, "mafpo-chain": 4_000, "mafpo-warm": 3_500}
"""Control steps in a second on one core of a workstation, validation included: assumed where no run tells."""
RUN_BYTES = 2_000_000
"""What a finished run takes on the disk, about."""


def cost(jobs: Sequence[Job], at_once: int) -> str:
    """Tell how many frames are left, and about how long that takes if so many are trained at once."""
    frames = sum(_left(job) for job in jobs)
    seconds = sum(_left(job) / _rate(job) for job in jobs)
    elapsed = seconds / max(min(at_once, len(jobs)), 1)
    space = sum(RUN_BYTES for job in jobs if not (job.directory / CHECKPOINT).exists())
    return (
        f"{len(jobs)} to train: {frames / 1e6:.1f} million frames, {_duration(seconds)} of one core, "
        f"about {_duration(elapsed)} with {at_once} at once, {space / 1e6:.0f} MB"
    )


def _duration(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h" if seconds >= 3600 else f"{seconds / 60:.0f} min"


def _left(job: Job) -> int:
    row = _last_row(job.directory)
    return max(job.frames - int(row["frames"]), 0) if row else job.frames


def _rate(job: Job) -> float:
    """Frames in a second of its own run, of another seed's, or as assumed."""
    for directory in (job.directory, *sorted(job.directory.parent.glob("seed-*"))):
        row = _last_row(directory)
        if row and float(row["seconds"]) > 0.0:
            return float(row["frames"]) / float(row["seconds"])
    return FRAMES_PER_S[job.algorithm]


def _last_row(directory: Path) -> dict[str, str] | None:
    try:
        with (directory / "metrics.csv").open(newline="") as file:
            return list(csv.DictReader(file))[-1]
    except (FileNotFoundError, IndexError):
        return None
