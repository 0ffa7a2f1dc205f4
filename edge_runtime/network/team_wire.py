"""The frame that one robot sends to another: a fixed layout, authenticated with the team's key.

Little endian: sender, receiver, version of the objectives, whether the sender listens to the receiver, boot
id, sequence, challenge, answer, the team's tick, the objectives' digest, digest and tick of the next ones,
stamp, position, velocity, heading, intended action. What the session fields are for:
`edge_runtime.team.peer`; the tick: `edge_runtime.team.tick`; the objectives: `edge_runtime.team.orders`.
"""

import math
import struct
from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, is_motion
from edge_runtime.messages import RobotState, Vector
from edge_runtime.network.seal import MAGIC_BYTES, TAG_BYTES, FrameError, Magic, Refusal, seal, unseal

LAST_TICK: Final = 2**62
"""No team gets there, also none with a member that leaps; counting on from there would not fit the frame."""
_BODY: Final = struct.Struct("<HHI?3x8Q8d")
FRAME_BYTES: Final = MAGIC_BYTES + _BODY.size + TAG_BYTES


class GuideVersions(msgspec.Struct, frozen=True, gc=False):
    """Which objectives guide a robot, and which it is committed to."""

    version: int = 0
    digest: int = 0
    """See `edge_runtime.guidance.guide.digest_of`."""
    next_digest: int = 0
    next_tick: int = 0
    """From this tick of the team on the next ones guide it; 0 if none are agreed."""


class Frame(msgspec.Struct, frozen=True, gc=False):
    """One robot's state as another one receives it; ``state.stamp_s`` is of the sender's clock."""

    receiver: int
    boot_id: int
    """Drawn by the sender at each start; sequences of different boots cannot be compared."""
    sequence: int
    challenge: int
    """What the receiver is to answer."""
    answer: int
    """The newest challenge that the sender had from the receiver; 0 before the first."""
    state: RobotState
    intended_action: Vector
    listens: bool = True
    """Whether the sender wants the receiver's frames."""
    tick: int = 0
    """The team's, as the sender counts."""
    versions: GuideVersions = GuideVersions()

    @property
    def stamp_s(self) -> float:
        """When the sender's state was measured, by its clock."""
        return self.state.stamp_s


def encode(frame: Frame, key: bytes) -> bytes:
    """Return the authenticated packet of a frame."""
    state, versions = frame.state, frame.versions
    body = _BODY.pack(
        state.robot_id,
        frame.receiver,
        versions.version,
        frame.listens,
        frame.boot_id,
        frame.sequence,
        frame.challenge,
        frame.answer,
        frame.tick,
        versions.digest,
        versions.next_digest,
        versions.next_tick,
        state.stamp_s,
        *state.position_m,
        *state.velocity_m_s,
        state.heading_rad,
        *frame.intended_action,
    )
    return seal(Magic.TEAM, body, key)


def decode(packet: bytes, key: bytes) -> Frame:
    """Read a packet.

    Raises:
        FrameError: if it is malformed, not made with this key, or a number is not finite or absurd.
    """
    body = unseal(packet, Magic.TEAM, key, _BODY.size, _BODY.size)
    sender, receiver, version, listens, boot_id, sequence, challenge, answer, *rest = _BODY.unpack(body)
    tick, digest, next_digest, next_tick, *numbers = rest
    if tick > LAST_TICK or next_tick > LAST_TICK:
        raise FrameError(Refusal.MALFORMED)
    if not all(map(math.isfinite, numbers)):
        raise FrameError(Refusal.NOT_FINITE)
    stamp, x, y, v_x, v_y, heading, a_x, a_y = numbers
    if not is_motion((x, y), (v_x, v_y)) or max(abs(heading), abs(a_x), abs(a_y)) > GREATEST:
        raise FrameError(Refusal.MALFORMED)
    state = RobotState(sender, stamp, (x, y), (v_x, v_y), heading)
    versions = GuideVersions(version, digest, next_digest, next_tick)
    return Frame(receiver, boot_id, sequence, challenge, answer, state, (a_x, a_y), listens, tick, versions)
