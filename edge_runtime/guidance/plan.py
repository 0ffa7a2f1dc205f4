"""What a robot follows: objectives made ready for its loop, with the name that the team knows them by."""

import functools
import hashlib
import sys
from pathlib import Path

import msgspec

from edge_runtime.config.fleet import Steering
from edge_runtime.guidance.settings import Guide
from edge_runtime.objectives import BUILT_IN, Objective
from edge_runtime.policy.manifest import Manifest


class Plan(msgspec.Struct, frozen=True):
    """Objectives and guidance that the loop takes up by one assignment."""

    steering: Steering
    guide: Guide
    start_noise: float
    """Deviation of the flow's start."""
    digest: int
    """See `digest_of`."""
    version: int = 0
    """0 is what the robot was started with; each set that the team agrees on has a higher one."""
    session: int = 0
    """Of the operator who sent it; 0 for none."""


def make_plan(steering: Steering, manifest: Manifest, *, guided: bool = True) -> Plan:
    """Make objectives ready for a policy's robot; one that is not guided follows none."""
    followed = steering if guided else msgspec.structs.replace(steering, objectives=())
    # Objectives look ahead in the policy's own control steps, whatever the rate it is run at.
    guide = Guide(followed.guidance, followed.objectives, manifest.dynamics)
    start_noise = followed.guidance.start_noise if manifest.start == "noise" else 0.0
    return Plan(steering, guide, start_noise, digest_of(followed))


def digest_of(steering: Steering) -> int:
    """First 64 bits of the SHA-256 of what objectives and guidance say, whatever the form of their file.

    The code of own objectives counts too: robots with different code disagree.
    """
    digest = hashlib.sha256(msgspec.json.encode(steering))
    for objective in steering.objectives:
        if type(objective) not in BUILT_IN:
            digest.update(_code_digest(type(objective)))
    return int.from_bytes(digest.digest()[:8], "little")


@functools.cache
def _code_digest(kind: type[Objective]) -> bytes:
    """SHA-256 of a class's module file, as it was when the class was first followed; of nothing without."""
    file = getattr(sys.modules[kind.__module__], "__file__", None)
    return hashlib.sha256(Path(file).read_bytes() if file else b"").digest()
