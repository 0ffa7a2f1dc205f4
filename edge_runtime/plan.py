"""What a robot follows: objectives made ready for its loop, with the name that the team knows them by."""

import hashlib

import msgspec

from edge_runtime.config import Steering
from edge_runtime.guide import Guide
from edge_runtime.manifest import Manifest


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
    """First 64 bits of the SHA-256 of what objectives and guidance say, whatever the form of their file."""
    return int.from_bytes(hashlib.sha256(msgspec.json.encode(steering)).digest()[:8], "little")
