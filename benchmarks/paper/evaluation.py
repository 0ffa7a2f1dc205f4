"""The work of an evaluation: every question is one row, answered by whichever process is free."""

import hashlib
import subprocess
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks.paper.contestants import Contestant
from benchmarks.paper.episodes import Setting, run_episodes
from benchmarks.paper.frequency import control_frequency
from benchmarks.paper.policies import digest, load_policy
from benchmarks.paper.rows import Key, Row, make_row
from benchmarks.paper.tasks import TASKS
from export.scenarios import definitions

EVALUATION_SEED = 2
"""Of starts, goals and noise that nothing was chosen by; tuning uses others."""


@dataclass(frozen=True)
class Question:
    """What one row is to answer."""

    task: str
    who: Contestant
    seed: int
    """Of the policy's training."""
    episodes: int
    euler_steps: int | None = None
    """T; None for the policy's own."""
    neighbours: int | None = None
    """K, the nearest at every step; None for all."""
    loss: float = 0.0
    """Share of the messages lost."""
    masses_kg: tuple[float, ...] | None = None
    """Of Navigation's robots; None for the task's own. The contestant's mode must tell them apart."""


def key(question: Question, policies: Path) -> Key:
    """What its row will be known by.

    Raises:
        ConfigError: if the policy is missing.
    """
    who = question.who
    bundle = load_policy(policies, question.task, who.algorithm, question.seed)
    return Key(
        question.task,
        who.method,
        who.mode,
        question.seed,
        question.episodes,
        EVALUATION_SEED,
        question.euler_steps,
        question.neighbours,
        question.loss,
        digest(bundle),
        definitions_digest(),
    )


def answer(question: Question, policies: Path) -> Row:
    """Run its episodes."""
    torch.set_num_threads(1)
    task, who, steps = TASKS[question.task], question.who, question.euler_steps
    bundle = load_policy(policies, question.task, who.algorithm, question.seed)
    make = who.make(bundle) if steps is None else who.make(bundle, euler_steps=steps)
    setting = Setting(
        question.episodes, EVALUATION_SEED, question.neighbours, question.loss, question.masses_kg
    )
    outcome = run_episodes(task, make, setting)
    hz = None if steps is None else control_frequency(task, bundle, steps)
    return make_row(task, outcome, key(question, policies), commit(), hz)


def answer_all(
    questions: Iterable[Question], policies: Path, jobs: int, known: Iterable[Row]
) -> Iterator[Row]:
    """Answer what is not known yet, in ``jobs`` processes; rows come as they are finished."""
    have = {row.key for row in known}
    todo = [question for question in questions if key(question, policies) not in have]
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(answer, question, policies) for question in todo]
        try:
            for future in as_completed(futures):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def definitions_digest() -> str:
    """The first half of the SHA-256 of the file that defines the tasks."""
    return hashlib.sha256(Path(definitions.__file__).read_bytes()).hexdigest()[:32]


def commit() -> str:
    """The checkout's commit; empty outside of one."""
    line = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)  # noqa: S603
    return done.stdout.strip()
