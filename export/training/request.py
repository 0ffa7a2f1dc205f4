"""What a training run is asked to do, checked before any process starts to do it."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from edge_runtime.errors import ConfigError
from export.algorithms.base import Algorithm, TrainingSettings
from export.algorithms.mafpo import Mafpo
from export.algorithms.mafpo_chain import MafpoChain
from export.algorithms.mafpo_warm import MafpoWarm
from export.algorithms.mappo import Mappo
from export.algorithms.pc_mappo import PcMappo
from export.scenarios import scenario_facts
from export.training.checkpoint import CHECKPOINT, RunIdentity, check_identity, load, read_identity
from export.training.warm_start import WarmStart, load_warm_start

ALGORITHMS = {algorithm.name: algorithm for algorithm in (Mafpo, MafpoChain, Mappo, MafpoWarm, PcMappo)}


@dataclass(frozen=True)
class Request:
    """What the user asked for."""

    scenario: str
    algorithm: str
    seed: int
    out: Path
    frames: int | None = None
    """None for the algorithm's default, or for what a resumed run was started with."""
    resume: bool = False
    warm_start: Path | None = None
    """Run of a Gaussian policy that a new `mafpo-warm` begins with."""

    @property
    def preferred(self) -> bool:
        """Whether the algorithm learns the execution objectives, with preferences that robots observe."""
        return self.algorithm == PcMappo.name


@dataclass(frozen=True)
class Beginning:
    """How the run begins."""

    settings: TrainingSettings
    identity: RunIdentity
    saved: dict[str, Any] | None
    """The checkpoint to continue from; None for a new run."""
    warm: WarmStart | None
    """What a new `mafpo-warm` begins with."""


def check_request(request: Request, workers: int, settings: TrainingSettings | None = None) -> Beginning:
    """Check a request; ``settings`` replace the algorithm's own.

    Raises:
        ConfigError: if the directory is taken or holds nothing to resume, if its checkpoint is damaged or
            another run's, if a warm start is missing, damaged or not wanted, or if the work cannot be shared
            equally.
    """
    _check_directory(request)
    _check_warm_start(request)
    path = request.out / CHECKPOINT
    saved = load(path) if request.resume else None
    settings = settings or ALGORITHMS[request.algorithm].settings
    begun = None if saved is None else read_identity(path, saved)
    settings = replace(settings, frames=request.frames or (begun or settings).frames)
    _check_shares(settings, workers)
    identity = _identify(request, workers, settings)
    if begun:
        check_identity(path, begun, identity)
    warm = load_warm_start(request.warm_start, request.scenario) if request.warm_start else None
    return Beginning(settings, identity, saved, warm)


def make_algorithm(request: Request) -> Algorithm:
    """Build the algorithm for the scenario's shapes, with random initial weights."""
    facts = scenario_facts(request.scenario, preferred=request.preferred)
    return ALGORITHMS[request.algorithm](facts.observation_dim, facts.action_dim)


def _check_directory(request: Request) -> None:
    started = os.path.exists(request.out / CHECKPOINT)  # noqa: PTH110  # pathlib's raises for too long names
    if started and not request.resume:
        raise ConfigError(
            f"{request.out} already holds a run: continue it with --resume or choose another --out"
        )
    if request.resume and not started:
        raise ConfigError(f"{request.out} holds no {CHECKPOINT} to resume: start it without --resume")


def _check_warm_start(request: Request) -> None:
    warm = request.algorithm == MafpoWarm.name
    if warm and not request.resume and request.warm_start is None:
        raise ConfigError(
            f"--algorithm {request.algorithm} needs --warm-start RUN, a run of --algorithm mappo"
        )
    if request.warm_start is not None and (request.resume or not warm):
        raise ConfigError(f"--warm-start is for new runs of --algorithm {MafpoWarm.name}: leave it out")


def _check_shares(settings: TrainingSettings, workers: int) -> None:
    for name in ("environments", "minibatch", "validation_episodes"):
        total = getattr(settings, name)
        if total % workers:
            raise ConfigError(f"--workers {workers} does not divide {total} {name}: choose one that does")


def _identify(request: Request, workers: int, settings: TrainingSettings) -> RunIdentity:
    actor = make_algorithm(request).actor
    return RunIdentity(
        scenario=request.scenario,
        algorithm=request.algorithm,
        seed=request.seed,
        frames=settings.frames,
        averaging=settings.averaging,
        workers=workers,
        observation_dim=actor.observation_dim,
        action_dim=actor.action_dim,
        hidden=actor.hidden,
    )
