"""The work of an evaluation: every question is one row, answered by whichever process is free."""

import hashlib
import subprocess
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from benchmarks.paper.candidates import candidates
from benchmarks.paper.contestants import Contestant
from benchmarks.paper.episodes import Setting, run_episodes
from benchmarks.paper.frequency import control_frequency
from benchmarks.paper.policies import digest, load_policy
from benchmarks.paper.rows import Key, Row, make_row
from benchmarks.paper.tasks import TASKS
from edge_runtime.errors import ConfigError
from export.scenarios import definitions

EVALUATION_SEED = 1
"""Of starts, goals and noise; tuning uses others."""


@dataclass(frozen=True)
class Question:
    """What one row is to answer."""

    task: str
    method: str
    mode: str
    seed: int
    """Of the policy's training."""
    episodes: int
    euler_steps: int | None = None
    """T; None for the policy's own."""


def contestant(question: Question) -> Contestant:
    """Who answers it.

    Raises:
        ConfigError: if the method has no such mode.
    """
    for candidate in candidates(TASKS[question.task], question.method):
        if candidate.mode == question.mode:
            if question.euler_steps is None:
                return candidate
            return replace(candidate, make=partial(candidate.make, euler_steps=question.euler_steps))
    raise ConfigError(f"{question.method} has no mode '{question.mode}': tune it with --tune")


def key(question: Question, policies: Path) -> Key:
    """What its row will be known by.

    Raises:
        ConfigError: if the policy is missing.
    """
    algorithm = contestant(question).algorithm
    bundle = load_policy(policies, question.task, algorithm, question.seed)
    return Key(
        question.task,
        question.method,
        question.mode,
        question.seed,
        question.episodes,
        question.euler_steps,
        digest(bundle),
        definitions_digest(),
    )


def answer(question: Question, policies: Path) -> Row:
    """Run its episodes."""
    torch.set_num_threads(1)
    task, who = TASKS[question.task], contestant(question)
    bundle = load_policy(policies, question.task, who.algorithm, question.seed)
    outcome = run_episodes(task, who.make(bundle), Setting(question.episodes, EVALUATION_SEED))
    hz = None if question.euler_steps is None else control_frequency(task, bundle, question.euler_steps)
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
