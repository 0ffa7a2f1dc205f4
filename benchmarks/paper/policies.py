"""Where the policies of the tables lie."""

import hashlib
from pathlib import Path

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import MANIFEST_FILE, Bundle
from edge_runtime.policy.manifest_file import read_manifest

VALUES = Path(__file__).parents[1] / "values"
SEEDS = 10
"""Of every method in the tables."""
FIRST_FRESH_SEED = 5
"""From here on policies were trained when definitions and candidate settings stood."""


def find_policy(root: Path, task: str, algorithm: str, seed: int) -> Path:
    """Return the directory of one seed's bundle: as committed, or as training leaves it.

    Raises:
        ConfigError: if it is missing, and says how to make it, or if it is the bundle of another policy.
    """
    directory = root / task / algorithm / f"seed-{seed}"
    for found in (directory / "bundle", directory):
        if (found / MANIFEST_FILE).exists():
            _check_origin(found, task, algorithm, seed)
            return found
    raise ConfigError(
        f"{directory}: no bundle of {algorithm} on {task} with seed {seed}; make it with "
        f"python -m export.train_all --scenarios {task} --algorithms {algorithm} --seeds {seed + 1}"
    )


def value_path(bundle: Bundle) -> Path:
    """Return where lies what actions are worth to a policy's task, see `export.values`.

    Raises:
        ConfigError: if the policy was trained elsewhere.
    """
    training = bundle.manifest.training
    if training is None:
        raise ConfigError(f"{bundle.directory}: a policy trained elsewhere, for no task of these")
    return VALUES / training.scenario / training.algorithm / f"seed-{training.seed}.npz"


def _check_origin(directory: Path, task: str, algorithm: str, seed: int) -> None:
    path = directory / MANIFEST_FILE
    training = read_manifest(path.read_bytes(), path).training
    if training is None:
        raise ConfigError(
            f"{directory}: a policy trained elsewhere, not {algorithm} on {task} with seed {seed}"
        )
    if (training.scenario, training.algorithm, training.seed) != (task, algorithm, seed):
        raise ConfigError(
            f"{directory}: {training.algorithm} on {training.scenario} with seed {training.seed}, "
            f"not {algorithm} on {task} with seed {seed}: export that into it"
        )


def digest(directory: Path) -> str:
    """The first half of the SHA-256 of a bundle's manifest, which names all its files' digests."""
    return hashlib.sha256((directory / MANIFEST_FILE).read_bytes()).hexdigest()[:32]
