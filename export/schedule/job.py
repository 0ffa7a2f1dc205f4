"""One policy of the paper's tables: what trains and exports it, from wherever it was left."""

import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from edge_runtime.common.child import python_command
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import MANIFEST_FILE
from export.algorithms.mafpo_warm import MafpoWarm
from export.algorithms.mappo import Mappo
from export.training.checkpoint import CHECKPOINT, load, read_identity
from export.training.lock import wait_until_free

FRAMES = {"navigation": 3_000_000, "balance": 5_000_000, "sampling": 4_000_000}
"""Control steps of every algorithm, by task; `python -m benchmarks curves` draws where learning ends."""
SEEDS = 10
LOG = "log.txt"


@dataclass(frozen=True)
class Job:
    """One policy."""

    scenario: str
    algorithm: str
    seed: int
    directory: Path

    @property
    def bundle(self) -> Path:
        """Where its bundle will lie."""
        return self.directory / "bundle"

    @property
    def finished(self) -> bool:
        """Whether it lies there."""
        return (self.bundle / MANIFEST_FILE).exists()

    @property
    def frames(self) -> int:
        """Control steps that it is trained for, besides its predecessor's."""
        return MafpoWarm.settings.frames if self.predecessor else FRAMES[self.scenario]

    @property
    def predecessor(self) -> "Job | None":
        """Whose policy it begins with."""
        if self.algorithm != MafpoWarm.name:
            return None
        directory = self.directory.parents[1] / Mappo.name / self.directory.name
        return Job(self.scenario, Mappo.name, self.seed, directory)

    def commands(self) -> Iterator[list[str]]:
        """What trains and exports it."""
        directory, before = str(self.directory), self.predecessor
        train = ["export.edge_train", self.scenario, "--algorithm", self.algorithm, "--seed", str(self.seed)]
        train += ["--frames", str(self.frames), "--out", directory]
        if (self.directory / CHECKPOINT).exists():
            train.append("--resume")
        elif before:
            train += ["--warm-start", str(before.directory)]
        yield train
        yield ["export.edge_export", directory, "--out", str(self.bundle)]


def jobs(out: Path, scenarios: Sequence[str], algorithms: Sequence[str], seeds: int) -> list[Job]:
    """All policies, the first seed of everything first, what another begins with before it."""
    return [
        Job(scenario, algorithm, seed, out / scenario / algorithm / f"seed-{seed}")
        for seed in range(seeds)
        for scenario in scenarios
        for algorithm in sorted(algorithms, key=MafpoWarm.name.__eq__)
    ]


def check_budget(job: Job) -> None:
    """Refuse to count what was trained for another number of frames as this policy.

    Raises:
        ConfigError: if its directory holds such a run, or its checkpoint is damaged.
    """
    if not (path := job.directory / CHECKPOINT).exists():
        return
    frames = read_identity(path, load(path)).frames
    if frames != job.frames:
        raise ConfigError(
            f"{job.directory} was trained for {frames} frames, not {job.frames}: choose another --out"
        )


def run(job: Job) -> None:
    """Train and export one policy; its output goes to ``log.txt`` in its directory.

    A process that trains there already, left behind by one that was killed, is waited for.

    Raises:
        ConfigError: if a command fails, or what the policy begins with is not finished.
    """
    if job.predecessor and not job.predecessor.finished:
        raise ConfigError(f"{job.directory}: begins with {job.predecessor.directory}, which is not finished")
    try:
        job.directory.mkdir(parents=True, exist_ok=True)
        wait_until_free(job.directory)
        for command in job.commands():
            _call(command, job.directory / LOG)
    except OSError as error:
        raise ConfigError(f"{job.directory}: nothing can be written there ({error.strerror})") from error


def _call(command: Sequence[str], log: Path) -> None:
    with log.open("a") as output:
        done = subprocess.run(  # noqa: S603  # ours
            python_command(*command), stdout=output, stderr=subprocess.PIPE, text=True, check=False
        )
        output.write(done.stderr)
    if done.returncode:
        said = done.stderr.strip().splitlines() or [f"{command[0]} ended with {done.returncode}"]
        raise ConfigError(f"{log.parent}: {said[-1]}")
