"""A robot's side of what an operator orders: objectives that all change at one tick, and the stop.

Objectives come in two steps. Each robot checks what is proposed, in a thread of its own, and says whether it
would follow it; when all have accepted, the operator commits them to one tick of the team. The commitment
rides in every frame to the teammates, so a robot that accepted learns of it from any of them, though the
operator or its packets be lost; one that learns of it after that tick changes at once.
"""

import threading
from collections.abc import Callable
from typing import Final, NamedTuple

from msgspec.structs import replace

from edge_runtime.errors import EdgeError
from edge_runtime.guidance.guide import Guide
from edge_runtime.network.order_wire import Abort, Ask, Commit, Order, Propose, Stage, Standing, Stop
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.team_wire import GuideVersions

VALID_S: Final = 10.0
"""No operator sends an order that holds for longer."""
MOST_LEAD: Final = 60_000
"""Ticks from a commitment to its tick; no operator plans farther ahead."""
HOLD_S: Final = 10.0
"""How long an accepted proposal keeps another operator's out, if nobody commits it."""
STACK_BYTES: Final = 2**20
"""Of that thread: with locked memory, mapping the usual 8 MiB would take the loop 5 ms."""
LONGEST_TEXT: Final = 1000
"""Of an answer, which must fit a packet whatever a user's objective says when it fails."""
LONGEST_LIST: Final = 300
STOPPED: Final = "stopped by edge-ctl"

Prepare = Callable[[str, bytes], Guide]
"""Makes ready an objectives file of this name and content; raises EdgeError if it would not be followed."""


class Pace(NamedTuple):
    """How a robot's loop goes."""

    tick: int
    """The team's."""
    rate_hz: float
    nominal_rate_hz: float


class Proposal:
    """Objectives on their way to being followed; checked by a thread that ends with the check."""

    def __init__(self, order: Propose, prepare: Prepare, now_s: float) -> None:
        self.session = order.session
        self.held_until_s = now_s + HOLD_S
        self.commit_tick: int | None = None
        self.guide: Guide | None = None
        """What is to be followed, once it is accepted."""
        self.complaint = ""
        """Why it is refused."""
        self._order, self._prepare = order, prepare
        before = threading.stack_size(STACK_BYTES)
        threading.Thread(target=self._check, name="objectives", daemon=True).start()
        threading.stack_size(before)

    @property
    def stage(self) -> Stage:
        """How far it has come."""
        if self.complaint:
            return "refused"
        if self.guide is None:
            return "checking"
        return "accepted" if self.commit_tick is None else "committed"

    def keeps_out(self, now_s: float) -> bool:
        """Whether another operator has to wait."""
        return self.commit_tick is not None or (not self.complaint and now_s < self.held_until_s)

    def _check(self) -> None:
        order = self._order
        try:
            guide = self._prepare(order.file, order.content)
        except EdgeError as error:
            self.complaint = str(error)
        except Exception as error:  # noqa: BLE001  # a user's objective may fail in any way
            self.complaint = f"{order.file}: {type(error).__name__}: {error}"
        else:
            self.guide = replace(guide, version=order.version)


class Orders:
    """What a robot was ordered.

    Args:
        robot_id: of this robot.
        boot_id: of this run, a random number.
        guide: what it follows from the start.
        prepare: see `Prepare`; called in a thread.
    """

    def __init__(self, robot_id: int, boot_id: int, guide: Guide, prepare: Prepare) -> None:
        self.guide = guide
        """What the robot follows."""
        self.stop_reason = ""
        """Why the run is to end; never taken back."""
        self._robot_id, self._boot_id, self._prepare = robot_id, boot_id, prepare
        self._proposal: Proposal | None = None
        self._session = 0  # of the operator whose objectives these are; 0 for none

    def obey(self, order: Order, now_s: float) -> str:
        """Act on an authentic order; taking it once more changes nothing.

        Returns:
            Why a proposal cannot even be checked; else empty.

        Raises:
            FrameError: if it is for another robot or run, or has expired.
        """
        if order.receiver != self._robot_id:
            raise FrameError(Refusal.MISDIRECTED)
        if isinstance(order, Ask):
            return ""
        if order.boot_id != self._boot_id or not now_s <= order.expires_s <= now_s + VALID_S:
            raise FrameError(Refusal.EXPIRED)
        proposal = self._proposal if self._proposal and self._proposal.session == order.session else None
        if isinstance(order, Stop):
            self.stop_reason = STOPPED
        elif isinstance(order, Propose) and proposal is None and order.session != self._session:
            return self._consider(order, now_s)
        elif isinstance(order, Commit) and proposal and proposal.guide is not None:
            # What a teammate told of the commitment must not put it off.
            proposal.commit_tick = min(order.tick, proposal.commit_tick or order.tick)
        elif isinstance(order, Abort) and proposal and proposal.commit_tick is None:
            self._proposal = None
        return ""

    def heard(self, teammate: GuideVersions, tick: int) -> None:
        """Learn from a teammate's frame, at a tick, whether what was accepted is committed, or followed."""
        proposal = self._proposal
        if proposal is None or proposal.guide is None or proposal.commit_tick is not None:
            return
        if 0 < teammate.next_tick <= tick + MOST_LEAD and teammate.next_digest == proposal.guide.digest:
            proposal.commit_tick = teammate.next_tick
        elif (teammate.version, teammate.digest) == (proposal.guide.version, proposal.guide.digest):
            proposal.commit_tick = 1

    def change(self, tick: int) -> bool:
        """Follow what is committed to this tick or an earlier one; whether that changed the guide."""
        proposal = self._proposal
        if proposal is None or proposal.guide is None or proposal.commit_tick is None:
            return False
        if tick < proposal.commit_tick:
            return False
        self.guide, self._session, self._proposal = proposal.guide, proposal.session, None
        return True

    def versions(self) -> GuideVersions:
        """Say what the robot follows, and what it is committed to."""
        proposal = self._proposal
        if proposal is None or proposal.guide is None or proposal.commit_tick is None:
            return GuideVersions(self.guide.version, self.guide.digest)
        return GuideVersions(
            self.guide.version, self.guide.digest, proposal.guide.digest, proposal.commit_tick
        )

    def standing(self, order: Order, complaint: str, now_s: float, pace: Pace, stop_reason: str) -> Standing:
        """Answer an order."""
        stage, why = self._stage(order.session)
        return Standing(
            order.session,
            order.number,
            self._robot_id,
            self._boot_id,
            now_s,
            pace.tick,
            pace.rate_hz,
            pace.nominal_rate_hz,
            self.guide.version,
            self.guide.digest,
            "refused" if complaint else stage,
            (complaint or why)[:LONGEST_TEXT],
            stop_reason or self.stop_reason,
            bool(self.stop_reason),
            self.guide.asked.text[:LONGEST_LIST],
        )

    def _consider(self, order: Propose, now_s: float) -> str:
        if self._proposal and self._proposal.keeps_out(now_s):
            return "another operator's objectives are on their way"
        if order.version <= self.guide.version:
            return f"version {order.version} is not above {self.guide.version}, which it follows"
        self._proposal = Proposal(order, self._prepare, now_s)
        return ""

    def _stage(self, session: int) -> tuple[Stage, str]:
        if self._proposal and self._proposal.session == session:
            return self._proposal.stage, self._proposal.complaint
        return ("applied" if self._session == session else "none"), ""
