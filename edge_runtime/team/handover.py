"""A policy on its way to a robot that drives: received, written to the disk, checked and made ready.

Nothing of it is executed; what counts is the signature. The robot goes on with what it has until the whole
team has accepted.
"""

import contextlib
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from edge_runtime.common.durable_file import replace_durably
from edge_runtime.common.paths import state_folder
from edge_runtime.config.fleet import Fleet
from edge_runtime.control.controller import Controller
from edge_runtime.control.mission import Mission, adapted
from edge_runtime.control.trust import require_trusted
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.guidance.settings import ObjectiveSet
from edge_runtime.network.order_wire import Chunk, Offer
from edge_runtime.policy.bundle import DIGEST_FILE, MANIFEST_FILE, Bundle, load_bundle
from edge_runtime.policy.bundle_source import BUNDLE_FILES
from edge_runtime.policy.manifest import Manifest
from edge_runtime.policy.signature import SIGNATURE_FILE

LARGEST_BUNDLE: Final = 16 * 2**20
"""Bytes of all its files."""
KEPT: Final = 4
"""Received policies that stay on the disk, the newest ones; who went back finds the one before."""


class Takeover(NamedTuple):
    """A policy made ready, and what the robot does with it."""

    mission: Mission
    controller: Controller

    @property
    def digest(self) -> int:
        """First 64 bits of the manifest's SHA-256."""
        return int(self.mission.bundle.sha256[:16], 16)


PreparePolicy = Callable[[Mapping[str, bytes], ObjectiveSet], Takeover]
"""Makes files ready that a bundle consists of; raises EdgeError if they would not be run."""


class Reception:
    """The bytes of a bundle's files, one after the other, as they come in.

    Raises:
        ConfigError: if no bundle has such files, or they are too large.
    """

    def __init__(self, order: Offer) -> None:
        self._files = order.files
        self._total = sum(size for _, size in order.files)
        names = [name for name, _ in order.files]
        if len(set(names)) < len(names) or not set(names) <= set(BUNDLE_FILES):
            raise ConfigError(f"a policy has the files {', '.join(BUNDLE_FILES)}, not {', '.join(names)}")
        if self._total > LARGEST_BUNDLE:
            raise ConfigError(f"a policy of {self._total} bytes is too large, at most {LARGEST_BUNDLE}")
        self._content = bytearray()

    @property
    def received(self) -> int:
        """How many bytes have come in without a gap."""
        return len(self._content)

    @property
    def complete(self) -> bool:
        """Whether that is all."""
        return self.received == self._total

    def take(self, chunk: Chunk) -> None:
        """Take in the next bytes; those before or beyond a gap will be sent again."""
        if chunk.offset == self.received:
            self._content += chunk.content[: self._total - self.received]

    def files(self) -> dict[str, bytes]:
        """Return the files by name; they must be complete."""
        begin, found = 0, {}
        for name, size in self._files:
            found[name] = bytes(self._content[begin : begin + size])
            begin += size
        return found


def bundle_files(bundle: Bundle) -> dict[str, bytes]:
    """Read the files of a signed bundle, as they are offered.

    Raises:
        BundleError: if one of them cannot be read.
    """
    names = (MANIFEST_FILE, DIGEST_FILE, SIGNATURE_FILE, *bundle.manifest.files)
    try:
        return {name: (bundle.directory / name).read_bytes() for name in names}
    except OSError as error:
        raise BundleError(f"{error.filename}: cannot be read ({error.strerror})") from error


class PolicyReceiver:
    """Makes received policies ready for a robot.

    Args:
        mission: the robot's.
        max_speed_m_s: greatest velocity setpoint that its link takes.
        max_yaw_rate_rad_s: greatest yaw rate that it takes.
    """

    def __init__(
        self, mission: Mission, max_speed_m_s: float = math.inf, max_yaw_rate_rad_s: float = math.inf
    ) -> None:
        self._mission, self._most = mission, (max_speed_m_s, max_yaw_rate_rad_s)

    def __call__(self, files: Mapping[str, bytes], asked: ObjectiveSet) -> Takeover:
        """Write, check and load a policy.

        Raises:
            EdgeError: if the robot may or can not run it; names why.
        """
        mission = self._mission
        fleet, robot = mission.fleet, mission.fleet.robot(mission.robot_id)
        _require_keys(fleet)
        directory = _stage(files, mission.robot_id)
        bundle = load_bundle(directory)
        require_trusted(bundle, fleet, robot.id)
        bundle = adapted(bundle, robot, fleet.team)
        _require_same_robot(mission.bundle.manifest, bundle.manifest, mission.period_s)
        made = replace(mission, bundle=bundle, objective_set=asked)
        controller = made.controller(robot.id, *self._most)
        controller.rehearse()
        return Takeover(made, controller)


def _require_same_robot(before: Manifest, after: Manifest, period_s: float) -> None:
    """Links and streams were opened for the robot of the policy that it was started with."""
    for what, one, other in (
        ("motion model", before.motion.at_period(period_s), after.motion.at_period(period_s)),
        ("action", before.action, after.action),
        ("body", before.body, after.body),
    ):
        if one != other:
            raise BundleError(
                f"the policy {after.name!r} is for another robot than {before.name!r}: its {what} differs; "
                "start the robots with it"
            )


def _require_keys(fleet: Fleet) -> None:
    if not fleet.team.trusted_keys:
        raise ConfigError("takes no policy over the network: [team] of its fleet file names no trusted_keys")


def _stage(files: Mapping[str, bytes], robot_id: int) -> Path:
    """Write a bundle into the user's state folder; on return it is on the disk."""
    folder = state_folder() / "policies" / f"robot{robot_id}"
    digest = files.get(DIGEST_FILE, b"")[:16].decode("ascii", "replace")
    directory = folder / (digest if digest.isalnum() else "unknown")
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            replace_durably(directory / name, content)
        _forget_old(folder, directory)
    except OSError as error:
        raise ConfigError(f"{directory}: cannot be written ({error.strerror})") from error
    return directory


def _forget_old(folder: Path, newest: Path) -> None:
    others = sorted(
        (each for each in folder.iterdir() if each != newest), key=lambda each: each.stat().st_mtime
    )
    for old in others[: max(0, len(others) + 1 - KEPT)]:
        with contextlib.suppress(OSError):
            shutil.rmtree(old)
