"""Who vouches for a bundle: an Ed25519 signature over its version and its manifest's digest.

The manifest holds the digests of all other files, so the signature covers every byte. It lies beside them in
``manifest.sig``. PyNaCl is loaded only where a key is named: robots that trust everybody need it not.
"""

from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from edge_runtime.common.command_line import need
from edge_runtime.common.durable_file import replace_durably
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import BundleError, ConfigError

SIGNATURE_FILE: Final = "manifest.sig"
LARGEST_SIGNATURE: Final = 4096
"""Bytes of the file."""
LARGEST_VERSION: Final = 2**53 - 1
"""What every reader of JSON holds."""
EXTRA: Final = "sign"


class Signature(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What ``manifest.sig`` says, in JSON."""

    format: Literal["cfpg-signature/1"]
    version: Annotated[int, msgspec.Meta(ge=1, le=LARGEST_VERSION)]
    """Counts the bundles of one name; a robot goes back behind none that it has run unless told to."""
    key: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    """The public key, in hexadecimal."""
    signature: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{128}$")]
    """In hexadecimal, of `statement`."""


def statement(version: int, sha256: str) -> bytes:
    """What is signed: a version and a manifest's digest."""
    return f"cfpg-signature/1\nversion {version}\nmanifest {sha256}\n".encode()


def sign(directory: Path, sha256: str, version: int, seed: bytes) -> Signature:
    """Sign a bundle and write the file.

    Args:
        directory: the bundle's.
        sha256: of its manifest, in hexadecimal.
        version: of the bundle, 1 or more.
        seed: the 32 bytes of the private key.

    Raises:
        ConfigError: if PyNaCl is missing, or the file cannot be written.
    """
    private = _nacl().SigningKey(seed)
    signed = private.sign(statement(version, sha256)).signature.hex()
    made = Signature("cfpg-signature/1", version, private.verify_key.encode().hex(), signed)
    path = directory / SIGNATURE_FILE
    try:
        replace_durably(path, msgspec.json.format(msgspec.json.encode(made)) + b"\n")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from error
    return made


def read_signature(directory: Path) -> Signature | None:
    """Read a bundle's signature, as yet unchecked; None where it has none.

    Raises:
        BundleError: if the file cannot be read, or is none.
    """
    path = directory / SIGNATURE_FILE
    try:
        return msgspec.json.decode(read_regular(path, LARGEST_SIGNATURE), type=Signature)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BundleError(f"{path}: cannot be read ({error.strerror}); sign the bundle again") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BundleError(f"{path}: is no signature ({error}); sign the bundle again") from error


def check_signature(directory: Path, sha256: str, trusted: tuple[str, ...]) -> Signature:
    """Check that one of the trusted keys signed a bundle.

    Args:
        directory: the bundle's.
        sha256: of its manifest, as it was loaded.
        trusted: public keys, in hexadecimal.

    Raises:
        BundleError: if it is unsigned, signed by another key, or not what was signed.
        ConfigError: if PyNaCl is missing.
    """
    found, path = read_signature(directory), directory / SIGNATURE_FILE
    if found is None:
        raise BundleError(
            f"{directory}: is not signed, and trusted_keys of [team] says who must have signed it; "
            "edge-export --sign KEY --out DIR signs a bundle"
        )
    if found.key not in trusted:
        raise BundleError(f"{path}: signed by {found.key}, which is none of [team]'s trusted_keys")
    nacl = _nacl()
    try:
        nacl.VerifyKey(bytes.fromhex(found.key)).verify(
            statement(found.version, sha256), bytes.fromhex(found.signature)
        )
    except (need("nacl.exceptions", EXTRA).CryptoError, ValueError) as error:
        raise BundleError(
            f"{path}: this bundle is not what was signed: it was changed, or the signature is another one's"
        ) from error
    return found


def _nacl() -> Any:  # noqa: ANN401  # the module, loaded where it is needed
    return need("nacl.signing", EXTRA)
