"""The frame that one robot sends to another: a fixed layout, authenticated with the team's key.

Little endian: sender, receiver, version of the objectives, whether the sender listens to the receiver,
components of its position (2 or 3) and of its action (1 to 8), boot id, sequence, challenge, answer, the
team's tick, the objectives' digest, digest and tick of the next ones, stamp, position, velocity, heading, yaw
rate, intended action; of what has fewer components the last are zero. What the session fields are for:
`edge_runtime.team.peer`; the tick: `edge_runtime.team.tick`; the objectives: `edge_runtime.team.orders`.
"""

import math
import struct
from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, is_motion
from edge_runtime.messages import LONGEST_ACTION, RobotState, Vector
from edge_runtime.network.seal import MAGIC_BYTES, TAG_BYTES, FrameError, Magic, Refusal, seal, unseal

LAST_TICK: Final = 2**62
"""No team gets there, also none with a member that leaps; counting on from there would not fit the frame."""
_BODY: Final = struct.Struct("<HHI?BBx8Q17d")
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
    dims, components = len(state.position_m), len(frame.intended_action)
    flat = (0.0,) * (3 - dims)
    body = _BODY.pack(
        state.robot_id,
        frame.receiver,
        versions.version,
        frame.listens,
        dims,
        components,
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
        *flat,
        *state.velocity_m_s,
        *flat,
        state.heading_rad,
        state.yaw_rate_rad_s,
        *frame.intended_action,
        *(0.0,) * (LONGEST_ACTION - components),
    )
    return seal(Magic.TEAM, body, key)


def decode(packet: bytes, key: bytes) -> Frame:
    """Read a packet.

    Raises:
        FrameError: if it is malformed, not made with this key, or a number is not finite or absurd.
    """
    body = unseal(packet, Magic.TEAM, key, _BODY.size, _BODY.size)
    sender, receiver, version, listens, dims, components, *rest = _BODY.unpack(body)
    boot_id, sequence, challenge, answer, tick, digest, next_digest, next_tick, *numbers = rest
    if dims not in (2, 3) or not 1 <= components <= LONGEST_ACTION:
        raise FrameError(Refusal.MALFORMED)
    if tick > LAST_TICK or next_tick > LAST_TICK:
        raise FrameError(Refusal.MALFORMED)
    if not all(map(math.isfinite, numbers)):
        raise FrameError(Refusal.NOT_FINITE)
    place, velocity = tuple(numbers[1 : 1 + dims]), tuple(numbers[4 : 4 + dims])
    action = tuple(numbers[9 : 9 + components])
    if not is_motion(place, velocity) or any(abs(number) > GREATEST for number in numbers[7:]):
        raise FrameError(Refusal.MALFORMED)
    state = RobotState(sender, numbers[0], place, velocity, *numbers[7:9])
    versions = GuideVersions(version, digest, next_digest, next_tick)
    return Frame(receiver, boot_id, sequence, challenge, answer, state, action, listens, tick, versions)
