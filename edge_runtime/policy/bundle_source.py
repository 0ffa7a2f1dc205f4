"""Where a policy comes from: a directory, or a repository of the Hugging Face Hub, ``hf://owner/name``.

What is fetched is cached by the Hub's own client, and read from there where the network is away. Whoever
wrote it, it is a bundle like any other: digests are checked when it is loaded, the signature where the fleet
file names keys, and nothing of it is executed.
"""

import contextlib
import importlib
import re
from pathlib import Path
from typing import Final

from edge_runtime.common.command_line import need
from edge_runtime.common.printable import first_line
from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import DIGEST_FILE, MANIFEST_FILE
from edge_runtime.policy.schema import GRAPH_FILE, LARGEST_FILE, WEIGHTS_FILE
from edge_runtime.policy.signature import SIGNATURE_FILE

BUNDLE_FILES: Final = (MANIFEST_FILE, DIGEST_FILE, SIGNATURE_FILE, GRAPH_FILE, WEIGHTS_FILE)
"""What a bundle may consist of; nothing else is fetched, or taken over a network."""
EXTRA: Final = "hub"
_HUB: Final = re.compile(r"hf:/+([\w.-]+/[\w.-]+)(?:@([\w./-]+))?", re.ASCII)
"""A path may have lost one of its slashes; behind the @ a branch, tag or commit."""


def is_remote(name: str) -> bool:
    """Whether a policy's name is that of a repository."""
    return name.startswith("hf:/")


def located(source: str, folder: Path = Path()) -> Path:
    """Return the directory of a policy, fetched if it is not here yet.

    Args:
        source: a directory, or a repository.
        folder: what a relative directory is relative to.

    Raises:
        ConfigError: if there is no such repository, it cannot be fetched, or a file of it is too large.
    """
    if not is_remote(source):
        return folder / source
    found = _HUB.fullmatch(source)
    if found is None:
        raise ConfigError(f"{source}: must be such as hf://owner/name or hf://owner/name@revision")
    need("huggingface_hub", EXTRA)
    try:
        return _fetched(found[1], found[2])
    except ConfigError:
        raise
    except Exception as error:  # the client's own, and those of what it calls
        raise ConfigError(f"hf://{found[1]}: cannot be fetched ({first_line(error)})") from error


def _fetched(repository: str, revision: str | None) -> Path:
    hub = importlib.import_module("huggingface_hub")
    importlib.import_module("huggingface_hub.utils").disable_progress_bars()
    wanted = {"repo_id": repository, "revision": revision, "allow_patterns": list(BUNDLE_FILES)}
    away = importlib.import_module("huggingface_hub.errors").DryRunError
    with contextlib.suppress(away):  # the network, or the Hub: what is cached was looked at when it came
        for file in hub.snapshot_download(**wanted, dry_run=True):
            if file.file_size > LARGEST_FILE:
                told = f"{file.filename} has {file.file_size} bytes, at most {LARGEST_FILE} are read"
                raise ConfigError(f"hf://{repository}: {told}")
    return Path(hub.snapshot_download(**wanted))
