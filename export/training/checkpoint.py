"""What a training run leaves on the disk: ``checkpoint.pt`` to resume from, ``best.pt`` to export."""

import contextlib
import io
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import msgspec
import torch
from msgspec import MsgspecError

from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError
from edge_runtime.policy.manifest import FlowStart, Training
from export.algorithms.networks import Actor, FlowNetwork
from export.training.run_file import write_run_file

CHECKPOINT = "checkpoint.pt"
BEST = "best.pt"
LARGEST_FILE = 1 << 30
"""Bytes of a checkpoint; those of the tasks here have a thousandth of it."""


@dataclass(frozen=True)
class RunIdentity:
    """What must be equal for a run to be the continuation of another."""

    scenario: str
    algorithm: str
    seed: int
    frames: int
    averaging: float
    """Of its weights; None in runs of earlier versions, which kept no averaged ones."""
    workers: int
    observation_dim: int
    action_dim: int
    hidden: tuple[int, ...]


class PolicyFacts(Training, frozen=True):
    """Where a trained policy comes from, and how it is to be run.

    The commit is of the training code, ``unknown`` outside a checkout; the score is the scenario's.
    """

    euler_steps: int
    """T that it was trained with."""
    start: FlowStart = "noise"
    preferred: bool = False
    """Whether it observes preferences between the task and its execution objectives."""

    @property
    def training(self) -> Training:
        """The part that a bundle's manifest tells."""
        return Training(*(getattr(self, name) for name in Training.__struct_fields__))


def save(path: Path, state: dict[str, Any]) -> None:
    """Write a state of tensors and plain values, atomically.

    Raises:
        ConfigError: if the file cannot be written.
    """
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_run_file(path, buffer.getvalue())


def load(path: Path) -> dict[str, Any]:
    """Read what ``save`` wrote, onto the CPU; nothing in the file is executed.

    Raises:
        ConfigError: if the file is missing, damaged, or none.
    """
    try:
        content = io.BytesIO(read_regular(path, LARGEST_FILE))
    except FileNotFoundError:
        raise ConfigError(f"{path} does not exist: name the --out directory of an edge-train run") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    told = f"{path} is damaged or not a checkpoint: train again into a new directory"
    try:
        state = torch.load(content, map_location="cpu", weights_only=True)
    except Exception as error:  # whatever torch makes of a file that is no checkpoint
        raise ConfigError(told) from error
    if not isinstance(state, dict):
        raise ConfigError(told)
    return state


@contextlib.contextmanager
def taken_from(path: Path, what: str) -> Iterator[None]:
    """Let whatever does not fit in the state of a file be one line about the file.

    Args:
        path: of the file.
        what: it should hold.

    Raises:
        ConfigError: if the state is another version's, or of something else.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, RuntimeError, MsgspecError) as error:
        raise ConfigError(
            f"{path} holds no {what} of this version: train again into a new directory"
        ) from error


def check_identity(path: Path, found: dict[str, Any], wanted: RunIdentity) -> None:
    """Refuse to continue one run as another.

    Raises:
        ConfigError: if any field differs; names both values.
    """
    for field in fields(RunIdentity):
        have, want = found.get(field.name), getattr(wanted, field.name)
        if have != want:
            raise ConfigError(
                f"{path} holds a run with {field.name} {have}, not {want}: "
                f"resume it with {field.name} {have} or choose another --out"
            )


def save_policy(directory: Path, actor: Actor, facts: PolicyFacts) -> None:
    """Write ``best.pt``: the flow that robots run, whatever was trained.

    Raises:
        ConfigError: if the file cannot be written.
    """
    flow = actor.as_flow()
    network = {
        "observation_dim": flow.observation_dim,
        "action_dim": flow.action_dim,
        "hidden": flow.hidden,
        "activation": flow.activation,
        "prior_std": flow.prior_std,
    }
    save(
        directory / BEST,
        {"facts": msgspec.structs.asdict(facts), "network": network, "actor": flow.state_dict()},
    )


def load_policy(run_dir: Path) -> tuple[FlowNetwork, PolicyFacts]:
    """Read the best-validated policy of a run directory.

    Raises:
        ConfigError: if ``best.pt`` is missing, damaged, or no policy.
    """
    path = Path(run_dir) / BEST
    state = load(path)
    with taken_from(path, "policy"):
        facts = msgspec.convert(state["facts"], PolicyFacts)
        actor = FlowNetwork(**state["network"])
        actor.load_state_dict(state["actor"])
    return actor.eval(), facts
