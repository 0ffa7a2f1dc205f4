"""The work of an evaluation: every question is one row, answered by whichever process is free."""

import hashlib
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import msgspec
import torch
from rich.progress import Progress

from benchmarks.common.result_file import read_result, write_result
from benchmarks.paper.episodes import run_episodes
from benchmarks.paper.frequency import control_frequency
from benchmarks.paper.methods import decider
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.rows import Key, Question, Row, make_row
from benchmarks.paper.tasks import TASKS
from edge_runtime.policy.bundle import load_bundle
from export.scenarios.definitions import DEFINITIONS

EVALUATION_SEED = 3
"""Of starts, goals and noise that nothing was chosen by; tuning uses others."""


def evaluate(questions: Sequence[Question], path: Path, policies: Path, jobs: int) -> list[Row]:
    """Answer what a file of rows does not, and return the rows that answer these questions, in their order.

    The file is written after each row, so that an interruption loses little, and keeps what it held, such as
    rows of other settings or definitions.

    Raises:
        ConfigError: if a policy is missing, or the file holds something else or cannot be written.
    """
    rows = read_result(path, list[Row], default=[])
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("rows", total=len(questions))
        for row in answer_all(questions, policies, jobs, rows):
            rows.append(row)
            write_result(path, rows)
            progress.advance(bar)
    known = {row.key: row for row in rows}
    return [known[key(question, policies)] for question in questions]


def key(question: Question, policies: Path) -> Key:
    """What its row will be known by.

    Raises:
        ConfigError: if the policy is missing.
    """
    return Key(question, digest(_policy(question, policies)), definition_digest(question.task))


def answer(question: Question, policies: Path) -> Row:
    """Run its episodes."""
    torch.set_num_threads(1)
    task, bundle = TASKS[question.task], load_bundle(_policy(question, policies))
    if question.euler_steps:
        bundle = bundle.sampled("euler", question.euler_steps)
    if question.exponential_steps:
        bundle = bundle.sampled("exponential", question.exponential_steps)
    outcome = run_episodes(task, decider(task, question.settings, bundle), question)
    hz = control_frequency(task, bundle) if question.euler_steps else None
    return make_row(key(question, policies), outcome, commit(), hz)


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


def definition_digest(task: str) -> str:
    """The first half of the SHA-256 of what defines a task."""
    return hashlib.sha256(msgspec.json.encode(DEFINITIONS[task])).hexdigest()[:32]


def commit() -> str:
    """The checkout's commit; empty outside of one."""
    line = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)  # noqa: S603
    return done.stdout.strip()


def _policy(question: Question, policies: Path) -> Path:
    return find_policy(policies, question.task, question.settings.algorithm(question.task), question.seed)
