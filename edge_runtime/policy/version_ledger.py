"""Which versions of signed policies a robot has run: it goes back behind none of them unless told to."""

from typing import Final

import msgspec

from edge_runtime.common.durable_file import replace_durably
from edge_runtime.common.paths import state_folder
from edge_runtime.common.regular_file import read_regular
from edge_runtime.errors import BundleError, ConfigError

LARGEST_LEDGER: Final = 1 << 20
"""Bytes of the file."""


class VersionLedger:
    """One robot's, in a file of the user's state: the newest version that it has run, by the policy's name.

    Args:
        robot_id: whose; several may be tried out on one machine.

    Raises:
        ConfigError: if this system does not know where the user's files are.
    """

    def __init__(self, robot_id: int) -> None:
        self.path = state_folder() / "policies" / f"robot{robot_id}.json"

    def check(self, name: str, version: int, *, allow_rollback: bool) -> None:
        """Refuse what is older than what was run.

        Raises:
            BundleError: names both versions.
            ConfigError: if the ledger cannot be read.
        """
        newest = self._versions().get(name, 0)
        if version < newest and not allow_rollback:
            received = self.path.with_suffix("")  # see `edge_runtime.team.handover`
            handed = f"; what it was handed lies in {received}" if received.is_dir() else ""
            raise BundleError(
                f"version {version} of policy {name!r} is older than version {newest}, which this robot has "
                f"run{handed}; --allow-rollback runs it all the same"
            )

    def note(self, name: str, version: int) -> None:
        """Remember that a version is run from now on, also an older one that somebody allowed.

        Raises:
            ConfigError: if the ledger cannot be read or written.
        """
        versions = self._versions()
        if versions.get(name) == version:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            replace_durably(self.path, msgspec.json.encode({**versions, name: version}))
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be written ({error.strerror})") from error

    def _versions(self) -> dict[str, int]:
        """What the file says; a damaged one is no reason to forget, and drives nobody."""
        try:
            return msgspec.json.decode(read_regular(self.path, LARGEST_LEDGER), type=dict[str, int])
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be read ({error.strerror})") from error
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ConfigError(
                f"{self.path}: is damaged ({error}); it says which versions of policies this robot has run. "
                "Delete it if you know that the next bundle is no older"
            ) from error
