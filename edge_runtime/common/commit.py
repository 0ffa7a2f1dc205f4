"""Which commit this software was made of."""

import contextlib
import subprocess
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import msgspec

UNKNOWN: Final = "unknown"
_HERE: Final = Path(__file__).parent


def commit() -> str:
    """Return the checkout's commit, with ``-dirty`` where files differ from it, or the installed package's.

    `UNKNOWN` where neither tells: a wheel names its version instead.
    """
    return _git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*") or _installed() or UNKNOWN


def _git(*arguments: str) -> str:
    """Ask git about the checkout that this file is tracked in; empty outside of one."""
    answer = ""
    for asked in (("ls-files", "--error-unmatch", __file__), arguments):
        command = ["git", "-C", str(_HERE), *asked]
        try:
            answer = subprocess.check_output(command, text=True, stderr=subprocess.DEVNULL).strip()  # noqa: S603
        except (OSError, subprocess.CalledProcessError):
            return ""
    return answer


def _installed() -> str:
    """What pip noted of a package that it installed from a repository (PEP 610)."""
    with contextlib.suppress(metadata.PackageNotFoundError, msgspec.DecodeError, KeyError):
        noted = metadata.distribution("cfpg-edge").read_text("direct_url.json") or "{}"
        found: dict[str, Any] = msgspec.json.decode(noted)
        return str(found["vcs_info"]["commit_id"])
    return ""
