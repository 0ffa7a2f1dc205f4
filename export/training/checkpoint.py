"""What a training run leaves on the disk: ``checkpoint.pt`` to resume from, ``best.pt`` to export."""

import contextlib
import io
import zipfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import msgspec
import torch
from msgspec import Meta

from edge_runtime.common.bounds import GREATEST
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError
from edge_runtime.policy.manifest import FlowStart, Network, Training
from edge_runtime.policy.schema import MAX_LAYERS, MAX_STEPS, MAX_WEIGHTS, MAX_WIDTH, check_training
from edge_runtime.policy.weight_file import require_plain
from export.algorithms.networks import Actor, FlowNetwork
from export.scenarios import scenario_facts
from export.scenarios.scenario import ScenarioFacts
from export.training.fitted import fitted, require_finite
from export.training.run_file import write_run_file

CHECKPOINT = "checkpoint.pt"
BEST = "best.pt"
LARGEST_FILE = 1 << 30
"""Bytes of a checkpoint; those of the tasks here have a thousandth of it."""


Count = Annotated[int, Meta(ge=1, le=2**63 - 1)]
Width = Annotated[int, Meta(ge=1, le=MAX_WIDTH)]
Layers = Annotated[tuple[Width, ...], Meta(min_length=1, max_length=MAX_LAYERS)]


class RunIdentity(msgspec.Struct, frozen=True, kw_only=True):
    """What must be equal for a run to be the continuation of another."""

    scenario: str
    algorithm: str
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    frames: Count
    averaging: float | None = None
    """Of its weights; None in runs of earlier versions, which kept no averaged ones."""
    workers: Count
    observation_dim: Count
    action_dim: Count
    hidden: Layers


class Shape(Network, frozen=True, kw_only=True):
    """What a trained flow is built of."""

    observation_dim: Width
    action_dim: Width
    hidden: Layers
    prior_std: Annotated[float, Meta(ge=1.0 / GREATEST, le=GREATEST)] | None

    def __post_init__(self) -> None:
        """Refuse what no robot loads, before room is made for it."""
        weights = sum(before * after for before, after in pairwise((self.observation_dim, *self.hidden)))
        if weights > MAX_WEIGHTS:
            raise ValueError(f"more than {MAX_WEIGHTS} weights")


class PolicyFacts(Training, frozen=True):
    """Where a trained policy comes from, and how it is to be run.

    The commit is of the training code, ``unknown`` outside a checkout; the score is the scenario's.
    """

    euler_steps: Annotated[int, Meta(ge=1, le=MAX_STEPS)]
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
        content = read_regular(path, LARGEST_FILE)
    except FileNotFoundError:
        raise ConfigError(f"{path} does not exist: name the --out directory of an edge-train run") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    told = f"{path} is damaged or not a checkpoint: train again into a new directory"
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            require_plain(archive.infolist(), len(content))
        state = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
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
    except Exception as error:  # whatever is made of a value that may be anything
        raise ConfigError(
            f"{path} holds no {what} of this version: train again into a new directory"
        ) from error


def read_identity(path: Path, state: dict[str, Any]) -> RunIdentity:
    """Say what run a checkpoint is of.

    Raises:
        ConfigError: if it does not say so.
    """
    with taken_from(path, "run"):
        return msgspec.convert(state["identity"], RunIdentity)


def check_identity(path: Path, found: RunIdentity, wanted: RunIdentity) -> None:
    """Refuse to continue one run as another.

    Raises:
        ConfigError: if any field differs; names both values.
    """
    for name in RunIdentity.__struct_fields__:
        have, want = getattr(found, name), getattr(wanted, name)
        if have != want:
            raise ConfigError(
                f"{path} holds a run with {name} {have}, not {want}: "
                f"resume it with {name} {have} or choose another --out"
            )


def save_policy(directory: Path, actor: Actor, facts: PolicyFacts) -> None:
    """Write ``best.pt``: the flow that robots run, whatever was trained.

    Raises:
        ConfigError: if the file cannot be written.
    """
    flow = actor.as_flow()
    network = {name: getattr(flow, name) for name in Shape.__struct_fields__}
    save(
        directory / BEST,
        {"facts": msgspec.structs.asdict(facts), "network": network, "actor": flow.state_dict()},
    )


def load_policy(run_dir: Path) -> tuple[FlowNetwork, PolicyFacts]:
    """Read the best-validated policy of a run directory.

    Raises:
        ConfigError: if ``best.pt`` is missing, damaged, no policy, or one of other shapes than its
            scenario's.
    """
    path = Path(run_dir) / BEST
    state = load(path)
    with taken_from(path, "policy"):
        facts = msgspec.convert(state["facts"], PolicyFacts)
        check_training(facts, str(path))
        scenario = scenario_facts(facts.scenario, preferred=facts.preferred)
        shape = msgspec.convert(state["network"], Shape)
    _check_spaces(run_dir, shape, scenario)
    with taken_from(path, "policy"):
        return _flow(shape, state["actor"]), facts


def _check_spaces(run_dir: Path, shape: Shape, scenario: ScenarioFacts) -> None:
    found, wanted = ((each.observation_dim, each.action_dim) for each in (shape, scenario))
    if found != wanted:
        raise ConfigError(
            f"{run_dir}: its policy takes {found[0]} numbers and returns {found[1]}, its scenario now has "
            f"{wanted[0]} and {wanted[1]}: train it again"
        )


def _flow(shape: Shape, weights: object) -> FlowNetwork:
    flow = FlowNetwork(**msgspec.structs.asdict(shape))
    flow.load_state_dict(fitted(weights, flow.state_dict()))
    usual = (flow.moments.mean + flow.moments.deviation).float()
    require_finite(flow(torch.ones(flow.action_dim), torch.full((1,), 0.5), usual))
    return flow.eval()
