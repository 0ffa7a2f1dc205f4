"""Where the policies of the tables lie."""

import hashlib
from pathlib import Path

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import MANIFEST_FILE

SEEDS = 10
"""Of every method in the tables."""
FIRST_FRESH_SEED = 5
"""From here on policies were trained when definitions and candidate settings stood."""


def find_policy(root: Path, task: str, algorithm: str, seed: int) -> Path:
    """Return the directory of one seed's bundle: as committed, or as training leaves it.

    Raises:
        ConfigError: if it is missing; says how to make it.
    """
    directory = root / task / algorithm / f"seed-{seed}"
    for found in (directory / "bundle", directory):
        if (found / MANIFEST_FILE).exists():
            return found
    raise ConfigError(
        f"{directory}: no bundle of {algorithm} on {task} with seed {seed}; make it with "
        f"python -m export.train_all --scenarios {task} --algorithms {algorithm} --seeds {seed + 1}"
    )


def digest(directory: Path) -> str:
    """The first half of the SHA-256 of a bundle's manifest, which names all its files' digests."""
    return hashlib.sha256((directory / MANIFEST_FILE).read_bytes()).hexdigest()[:32]
