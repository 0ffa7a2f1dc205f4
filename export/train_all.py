"""Train and export every policy of the paper's tables: each algorithm on each task with ten seeds.

    python -m export.train_all --out runs --jobs 2

Interrupt it whenever you like: what is finished stays, the rest goes on from its last checkpoint. The
bundles come to lie in ``OUT/<scenario>/<algorithm>/seed-<n>/bundle``.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from edge_runtime.common.child import python_command
from edge_runtime.errors import ConfigError, EdgeError
from edge_runtime.policy.bundle import MANIFEST_FILE
from export.algorithms.mafpo_warm import MafpoWarm
from export.algorithms.mappo import Mappo
from export.training.checkpoint import CHECKPOINT
from export.training.request import ALGORITHMS

FRAMES = {"navigation": 700_000, "balance": 2_000_000, "sampling": 900_000}
"""Control steps after which training has settled, by task."""
SEEDS = 10


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
    def predecessor(self) -> "Job | None":
        """Whose policy it begins with."""
        if self.algorithm != MafpoWarm.name:
            return None
        directory = self.directory.parents[1] / Mappo.name / self.directory.name
        return Job(self.scenario, Mappo.name, self.seed, directory)

    def commands(self) -> Iterator[list[str]]:
        """What trains and exports it, from wherever it was left."""
        directory, before = str(self.directory), self.predecessor
        frames = MafpoWarm.settings.frames if before else FRAMES[self.scenario]
        train = ["export.edge_train", self.scenario, "--algorithm", self.algorithm, "--seed", str(self.seed)]
        train += ["--frames", str(frames), "--out", directory]
        if (self.directory / CHECKPOINT).exists():
            train.append("--resume")
        elif before:
            train += ["--warm-start", str(before.directory)]
        yield train
        yield ["export.edge_export", directory, "--out", str(self.bundle)]


def jobs(out: Path, scenarios: Sequence[str], algorithms: Sequence[str], seeds: int) -> list[Job]:
    """All policies, the first seed of everything first."""
    return [
        Job(scenario, algorithm, seed, out / scenario / algorithm / f"seed-{seed}")
        for seed in range(seeds)
        for scenario in scenarios
        for algorithm in algorithms
    ]


def run(job: Job) -> None:
    """Train and export one policy; its output goes to ``log.txt`` in its directory.

    Raises:
        ConfigError: if a command fails, or what the policy begins with is not finished.
    """
    if job.predecessor and not job.predecessor.finished:
        raise ConfigError(f"{job.directory}: begins with {job.predecessor.directory}, which is not finished")
    job.directory.mkdir(parents=True, exist_ok=True)
    with (job.directory / "log.txt").open("a") as log:
        for command in job.commands():
            line = python_command(*command)
            if subprocess.run(line, stdout=log, stderr=log, check=False).returncode:  # noqa: S603  # ours
                raise ConfigError(f"{job.directory}: {command[0]} failed, see the end of {log.name}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; returns the exit code."""
    options = _parse(arguments)
    wanted = jobs(options.out, options.scenarios, options.algorithms, options.seeds)
    open_jobs = [job for job in wanted if not job.finished]
    print(f"{len(wanted) - len(open_jobs)} of {len(wanted)} policies are finished", flush=True)
    failures = 0
    # What begins with another's policy waits until all those are there.
    waves = [[job for job in open_jobs if bool(job.predecessor) == warm] for warm in (False, True)]
    with ThreadPoolExecutor(options.jobs) as pool:
        for wave in waves:
            for job, failure in zip(wave, pool.map(_attempt, wave), strict=True):
                failures += bool(failure)
                print(failure or f"finished {job.bundle}", flush=True)
    return 1 if failures else 0


def _attempt(job: Job) -> str:
    """Run a job; returns what went wrong."""
    try:
        run(job)
    except EdgeError as error:
        return f"train_all: {error}"
    return ""


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m export.train_all", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="policies trained side by side (1)")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"seeds 0 to N - 1 ({SEEDS})")
    parser.add_argument("--scenarios", nargs="*", choices=list(FRAMES), default=list(FRAMES))
    parser.add_argument("--algorithms", nargs="*", choices=list(ALGORITHMS), default=list(ALGORITHMS))
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
