"""The certificates of a team on Zenoh: files that are there, private, and fit each other and the robot.

Zenoh itself would only log what does not fit, and the robot would wait for its team for ever. So what a
teammate will check is checked at start: this robot's end shakes hands with itself in memory.
"""

import ssl
from pathlib import Path
from typing import Any, Final

import msgspec

from edge_runtime.common.key_file import read_private
from edge_runtime.common.paths import named_file
from edge_runtime.common.regular_file import read_regular
from edge_runtime.config.network import TlsSettings
from edge_runtime.errors import ConfigError

ROUTER: Final = "router"
"""The common name in a router's certificate."""
_PEM_BYTES: Final = 65536


class TlsFiles(msgspec.Struct, frozen=True):
    """Where one robot's certificates lie."""

    ca: Path
    certificate: Path
    private_key: Path


def common_name(robot_id: int) -> str:
    """Return the common name that a robot's certificate must have."""
    return f"robot-{robot_id}"


def tls_files(settings: TlsSettings, folder: Path, robot_id: int) -> TlsFiles:
    """Return a robot's files; ``{id}`` in a name stands for its id, names are relative to ``folder``.

    Raises:
        ConfigError: if one is missing, the private key is open to others, or they do not make the robot's
            certificate by this authority.
    """
    ca, certificate, private_key = (
        named_file(folder, name.replace("{id}", str(robot_id)))
        for name in (settings.ca, settings.certificate, settings.private_key)
    )
    files = TlsFiles(ca, certificate, private_key)
    _check_private(private_key)
    name = _proven_name(files)
    if name != common_name(robot_id):
        raise ConfigError(
            f"carrier.tls.certificate: {certificate} is of {name!r}, not of {common_name(robot_id)!r}; "
            "issue it with that common name"
        )
    return files


def _check_private(path: Path) -> None:
    try:
        read_private(path, _PEM_BYTES)
    except OSError as error:
        raise ConfigError(f"carrier.tls.private_key: {path} cannot be read ({error.strerror})") from error
    except ConfigError as error:
        raise ConfigError(f"carrier.tls.private_key: {error}") from error


def _proven_name(files: TlsFiles) -> str:
    """Return the certificate's common name as a teammate learns it."""
    server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False  # robots change their addresses: the common name says who they are
    try:
        read_regular(files.ca, _PEM_BYTES)  # a pipe would hold up the library
        client.load_verify_locations(files.ca)
    except OSError as error:  # ssl.SSLError is one
        raise ConfigError(f"carrier.tls.ca: {files.ca} cannot be used ({_cause(error)})") from error
    try:
        read_regular(files.certificate, _PEM_BYTES)
        server.load_cert_chain(files.certificate, files.private_key, password="")
        subject = _shake_hands(server, client)
    except OSError as error:
        raise ConfigError(
            f"carrier.tls.certificate: {files.certificate} cannot be used with {files.private_key.name} "
            f"and {files.ca.name} ({_cause(error)})"
        ) from error
    return subject.get("commonName", "")


def _shake_hands(server: ssl.SSLContext, client: ssl.SSLContext) -> dict[str, str]:
    """Return the subject of the server's certificate, which the client has verified."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    one = server.wrap_bio(to_server, to_client, server_side=True)
    two = client.wrap_bio(to_client, to_server)
    for end in (two, one, two):  # hello; certificate; verified
        try:
            end.do_handshake()
        except ssl.SSLWantReadError:
            continue
    subject: Any = (two.getpeercert() or {}).get("subject", ())
    return dict(pair for relative_name in subject for pair in relative_name)


def _cause(error: OSError) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return error.verify_message
    return error.strerror or getattr(error, "reason", "") or str(error)
