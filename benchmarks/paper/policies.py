"""Where the policies of the tables lie."""

import hashlib
from pathlib import Path

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import MANIFEST_FILE, Bundle, load_bundle

POLICIES = Path(__file__).parents[1] / "policies"
"""The committed bundles of all seeds."""
SEEDS = 10
"""Of every method in the tables."""
FIRST_FRESH_SEED = 5
"""From here on policies were trained when definitions and candidate settings stood."""


def load_policy(root: Path, task: str, algorithm: str, seed: int) -> Bundle:
    """Load one seed's bundle.

    Raises:
        ConfigError: if it is missing; says how to make it.
        BundleError: if it is damaged.
    """
    directory = policy_directory(root, task, algorithm, seed)
    if not (directory / MANIFEST_FILE).exists():
        raise ConfigError(
            f"{directory}: no bundle of {algorithm} on {task} with seed {seed}; make it with "
            f"python -m export.train_all --scenarios {task} --algorithms {algorithm} --seeds {seed + 1}"
        )
    return load_bundle(directory)


def policy_directory(root: Path, task: str, algorithm: str, seed: int) -> Path:
    """Where one seed's bundle lies: as committed, or as training leaves it."""
    directory = root / task / algorithm / f"seed-{seed}"
    return directory / "bundle" if (directory / "bundle").is_dir() else directory


def digest(bundle: Bundle) -> str:
    """The first half of the SHA-256 of a bundle's manifest, which names all its files' digests."""
    return hashlib.sha256((bundle.directory / MANIFEST_FILE).read_bytes()).hexdigest()[:32]
