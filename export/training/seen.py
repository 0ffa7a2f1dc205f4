"""What a policy saw in training: the range of each number that it observes, by rolling it out there.

Episodes start as in training, which widens the starts, and last as long; the flow starts as on the robot.
What a policy saw in its first clumsy rounds does not count: it may be anything, and says little of where it
can be trusted now.
"""

import io
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import torch
from msgspec.structs import replace

from edge_runtime.common.arrays import Floats
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import ConfigError
from edge_runtime.observation import ObservationField
from edge_runtime.policy.bundle import Bundle
from edge_runtime.policy.manifest import Manifest
from export.bundle.facts import Facts
from export.evaluation.guidance import unguided_actions
from export.scenarios import make_scenario

TEAMS: Final = 500
EPISODES: Final = 4
"""Of each team; a robot sees some 1,000 times as many observations as an episode has steps."""
LARGEST_FILE: Final = 1 << 28
"""Bytes of a calibration file."""


Stated = TypeVar("Stated", Manifest, Facts)


def roll_out(bundle: Bundle, teams: int = TEAMS, episodes: int = EPISODES, seed: int = 0) -> Floats:
    """Return least and greatest value (2, O) of what a policy observes in its training's task.

    Args:
        bundle: of a policy that was trained here.
        teams: that drive side by side.
        episodes: of each.
        seed: of starts and noise.
    """
    manifest, training = bundle.manifest, bundle.manifest.training
    if training is None:
        told = "was not trained here; give what it saw with --calibration FILE.npz"
        raise ConfigError(f"{bundle.directory}: {told}")
    preferred = training.algorithm == "pc-mappo"
    world = make_scenario(
        training.scenario, teams, seed, torch.device("cpu"), training=True, preferred=preferred
    )
    policy = bundle.policy(teams * world.facts.robots)
    low, high = ([getattr(field, end) for field in manifest.action] for end in ("low", "high"))
    noise, draw = float(manifest.start == "noise"), np.random.default_rng(seed)
    extremes = np.array([[np.inf], [-np.inf]]).repeat(manifest.observation_dim, 1)
    for _ in range(episodes):
        for _ in range(world.facts.training_steps):
            observation = world.observe().flatten(0, 1).numpy()
            extremes = _widened(extremes, observation)
            start = noise * draw.standard_normal((len(observation), manifest.action_dim))
            action = unguided_actions(policy, observation, start)
            taken = np.clip(action, low, high).reshape(teams, -1, manifest.action_dim)
            world.reset(world.step(torch.from_numpy(taken).float()).terminated)
        world.reset(torch.ones(teams, dtype=torch.bool))
    return extremes


def read_calibration(path: Path, observation_dim: int) -> Floats:
    """Return least and greatest value (2, O) of the array ``observation`` (n, O) of an ``.npz`` file.

    Raises:
        ConfigError: names the file and what it must hold.
    """
    wanted = f"must hold an array `observation` of n rows of {observation_dim} finite numbers"
    try:
        content = io.BytesIO(read_regular(path, LARGEST_FILE))
        with np.load(content, allow_pickle=False) as file:
            values = np.asarray(file["observation"], np.float64)
    except OSError as error:
        raise ConfigError(f"--calibration {path}: cannot be read ({error.strerror or error})") from error
    except Exception as error:  # whatever numpy and zipfile make of a file that is no archive
        raise ConfigError(f"--calibration {path}: {wanted}") from error
    if values.ndim != 2 or values.shape[1] != observation_dim or not len(values):
        raise ConfigError(f"--calibration {path}: {wanted}, got the shape {values.shape}")
    if not np.isfinite(values).all():
        raise ConfigError(f"--calibration {path}: {wanted}, got some that are not finite")
    return np.stack([values.min(0), values.max(0)])


def with_seen(stated: Stated, extremes: Floats) -> Stated:
    """Return a manifest, or the facts of one, with the ranges (2, O) of what its policy saw."""
    return replace(stated, observation=tuple(_fields(stated.observation, extremes)))


def _fields(fields: tuple[ObservationField, ...], extremes: Floats) -> Iterator[ObservationField]:
    ends = list(accumulate(field.size for field in fields))
    for field, end in zip(fields, ends, strict=True):
        pairs = extremes[:, end - field.size : end].T.tolist()
        yield replace(field, seen=tuple((low, high) for low, high in pairs))


def _widened(extremes: Floats, observation: Floats) -> Floats:
    low, high = extremes
    return np.stack([np.minimum(low, observation.min(0)), np.maximum(high, observation.max(0))])
