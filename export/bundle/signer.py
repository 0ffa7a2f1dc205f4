"""Signing a bundle with the key of a file."""

from pathlib import Path

from edge_runtime.common.command_line import need
from edge_runtime.common.key_file import read_key
from edge_runtime.policy.bundle import load_bundle
from edge_runtime.policy.signature import EXTRA, read_signature, sign


class Signer:
    """Signs one bundle; made before the bundle is, so that what is missing is said before the work.

    Args:
        key: file of the private key.
        directory: the bundle's.
        version: what to sign; one above what the directory holds so far where None.

    Raises:
        ConfigError: if the key cannot be used, or PyNaCl is missing.
        BundleError: if the directory holds a file that is no signature.
    """

    def __init__(self, key: Path, directory: Path, version: int | None) -> None:
        self._seed, self._directory = read_key(key), directory
        need("nacl.signing", EXTRA)
        before = read_signature(directory)
        self._version = version or (before.version + 1 if before else 1)

    def sign(self) -> str:
        """Sign the bundle as it lies there now; says by which key, and how robots come to trust it.

        Raises:
            EdgeError: if the bundle is damaged, or the signature cannot be written.
        """
        bundle = load_bundle(self._directory)
        made = sign(self._directory, bundle.sha256, self._version, self._seed)
        return (
            f"{self._directory}: signed as version {made.version} of {bundle.manifest.name}\n"
            f'robots trust this key with: [team] trusted_keys = ["{made.key}"]'
        )
