"""A robot's side of what an operator orders: objectives that all change at one tick, and the stop.

Objectives come in two steps. Each robot checks what is proposed, in a thread of its own, and says whether it
would follow it; when all have accepted, the operator commits them to one tick of the team. The commitment
rides in every frame to the teammates, so a robot that accepted learns of it from any of them, though the
operator or its packets be lost; one that learns of it after that tick changes at once.

A policy goes the same way: its files come in chunks, are checked by all, and before the commitment the
operator has all robots stand, which they do until that tick.
"""

import math
import threading
from collections.abc import Callable
from functools import partial
from typing import Final, NamedTuple

from msgspec.structs import replace

from edge_runtime.errors import EdgeError
from edge_runtime.guidance.guide import Guide
from edge_runtime.network.order_wire import (
    Abort,
    Ask,
    Chunk,
    Commit,
    Halt,
    Offer,
    Order,
    Propose,
    Stage,
    Standing,
    Stop,
)
from edge_runtime.network.seal import FrameError, Refusal
from edge_runtime.network.team_wire import GuideVersions
from edge_runtime.policy.bundle import Bundle
from edge_runtime.team.handover import PreparePolicy, Reception, Takeover

VALID_S: Final = 10.0
"""No operator sends an order that holds for longer."""
MOST_LEAD: Final = 60_000
"""Ticks from a commitment to its tick; no operator plans farther ahead."""
HALT_S: Final = 2.0
"""How long a robot stands after the last order to; then it drives on with what it has."""
HANDOVER: Final = "stands while a policy is handed over"
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


class Agreed(NamedTuple):
    """What is to be followed once it is committed."""

    guide: Guide
    takeover: Takeover | None = None
    """The policy that comes with it; None where the robot keeps what it runs."""


class Proposal:
    """Objectives, or a policy, on their way to being followed; checked by a thread that ends with the check.

    Args:
        session: the operator's.
        version: of what it makes the robot follow.
        name: of what is proposed, for messages.
        now_s: the robot's time.
        reception: of a policy's files; None for objectives.
    """

    def __init__(
        self, session: int, version: int, name: str, now_s: float, reception: Reception | None = None
    ) -> None:
        self.session = session
        self.held_until_s = now_s + HOLD_S
        self.commit_tick: int | None = None
        self.agreed: Agreed | None = None
        """What is to be followed, once it is accepted."""
        self.complaint = ""
        """Why it is refused."""
        self.reception = reception
        self.version = version
        self._name = name
        self._begun = False

    @property
    def stage(self) -> Stage:
        """How far it has come."""
        if self.complaint:
            return "refused"
        if self.agreed is None:
            return "checking" if self._begun else "receiving"
        return "accepted" if self.commit_tick is None else "committed"

    def keeps_out(self, now_s: float) -> bool:
        """Whether another operator has to wait."""
        return self.commit_tick is not None or (not self.complaint and now_s < self.held_until_s)

    def check(self, prepare: Callable[[], Agreed]) -> None:
        """Begin to make it ready, once."""
        if self._begun:
            return
        self._begun = True
        before = threading.stack_size(STACK_BYTES)
        threading.Thread(target=self._check, args=(prepare,), name="proposal", daemon=True).start()
        threading.stack_size(before)

    def _check(self, prepare: Callable[[], Agreed]) -> None:
        try:
            self.agreed = prepare()
        except EdgeError as error:
            self.complaint = str(error)
        except Exception as error:  # noqa: BLE001  # a user's objective may fail in any way
            self.complaint = f"{self._name}: {type(error).__name__}: {error}"


class Orders:
    """What a robot was ordered.

    Args:
        robot_id: of this robot.
        boot_id: of this run, a random number.
        guide: what it follows from the start.
        prepare: see `Prepare`; called in a thread.
        prepare_policy: see `PreparePolicy`; called in a thread. The robot takes no policies where None.
        policy: the bundle that it runs, in words.
    """

    def __init__(
        self,
        robot_id: int,
        boot_id: int,
        guide: Guide,
        prepare: Prepare,
        prepare_policy: PreparePolicy | None = None,
        policy: str = "",
    ) -> None:
        self.guide = guide
        """What the robot follows."""
        self.stop_reason = ""
        """Why the run is to end; never taken back."""
        self.takeover: Takeover | None = None
        """The policy that was handed over last; None if none was."""
        self._robot_id, self._boot_id, self._prepare = robot_id, boot_id, prepare
        self._prepare_policy, self._policy = prepare_policy, policy
        self._halted_until_s = -math.inf
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
        elif isinstance(order, Propose | Offer) and proposal is None and order.session != self._session:
            return self._consider(order, now_s)
        elif isinstance(order, Chunk | Halt) and proposal:
            self._carry_on(order, proposal, now_s)
        elif isinstance(order, Commit) and proposal and proposal.agreed is not None:
            # What a teammate told of the commitment must not put it off.
            proposal.commit_tick = min(order.tick, proposal.commit_tick or order.tick)
        elif isinstance(order, Abort) and proposal and proposal.commit_tick is None:
            self._proposal, self._halted_until_s = None, -math.inf
        return ""

    def pause(self, now_s: float) -> str:
        """Why the robot is to stand while policies are exchanged; empty if it need not."""
        proposal = self._proposal
        if proposal is None or proposal.reception is None:
            return ""
        return HANDOVER if proposal.commit_tick is not None or now_s < self._halted_until_s else ""

    def heard(self, teammate: GuideVersions, tick: int) -> None:
        """Learn from a teammate's frame, at a tick, whether what was accepted is committed, or followed."""
        proposal = self._proposal
        if proposal is None or proposal.agreed is None or proposal.commit_tick is not None:
            return
        guide = proposal.agreed.guide
        if 0 < teammate.next_tick <= tick + MOST_LEAD and teammate.next_digest == guide.digest:
            proposal.commit_tick = teammate.next_tick
        elif (teammate.version, teammate.digest) == (guide.version, guide.digest):
            proposal.commit_tick = 1

    def change(self, tick: int) -> bool:
        """Follow what is committed to this tick or an earlier one; whether that changed the guide."""
        proposal = self._proposal
        if proposal is None or proposal.agreed is None or proposal.commit_tick is None:
            return False
        if tick < proposal.commit_tick:
            return False
        self.guide, takeover = proposal.agreed
        if takeover is not None:
            self.takeover, self._prepare = takeover, takeover.mission.guide_of
            self._policy = policy_text(takeover.mission.bundle)
        self._session, self._proposal = proposal.session, None
        return True

    def versions(self) -> GuideVersions:
        """Say what the robot follows, and what it is committed to."""
        proposal = self._proposal
        if proposal is None or proposal.agreed is None or proposal.commit_tick is None:
            return GuideVersions(self.guide.version, self.guide.digest)
        following = proposal.agreed.guide.digest
        return GuideVersions(self.guide.version, self.guide.digest, following, proposal.commit_tick)

    def standing(
        self,
        order: Order,
        complaint: str,
        now_s: float,
        pace: Pace,
        stop_reason: str,
        *,
        at_rest: bool = False,
    ) -> Standing:
        """Answer an order."""
        stage, why = self._stage(order.session)
        proposal = self._proposal
        reception = proposal.reception if proposal and proposal.session == order.session else None
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
            reception.received if reception else 0,
            at_rest and bool(self.pause(now_s)),
            self._policy[:LONGEST_LIST],
        )

    def _consider(self, order: Propose | Offer, now_s: float) -> str:
        if self._proposal and self._proposal.keeps_out(now_s):
            return "another operator's objectives or policy are on their way"
        if order.version <= self.guide.version:
            return f"version {order.version} is not above {self.guide.version}, which it follows"
        if isinstance(order, Propose):
            self._proposal = Proposal(order.session, order.version, order.file, now_s)
            self._proposal.check(partial(self._objectives, order))
            return ""
        if self._prepare_policy is None:
            return "takes no policies over the network"
        try:
            reception = Reception(order)
        except EdgeError as error:
            return str(error)
        self._proposal = Proposal(order.session, order.version, "policy", now_s, reception)
        return ""

    def _carry_on(self, order: Chunk | Halt, proposal: Proposal, now_s: float) -> None:
        """Take in what comes of a policy, or stand until it is taken up; all others have to wait."""
        proposal.held_until_s = now_s + HOLD_S
        if isinstance(order, Halt):
            self._halted_until_s = now_s + HALT_S
        elif proposal.reception and not proposal.reception.complete:
            proposal.reception.take(order)
        if proposal.reception and proposal.reception.complete and self._prepare_policy:
            files = proposal.reception.files
            proposal.check(partial(self._handed_over, self._prepare_policy, files, proposal.version))

    def _objectives(self, order: Propose) -> Agreed:
        guide = self._prepare(order.file, order.content)
        return Agreed(replace(guide, version=order.version, digest=guide.digest ^ self._policy_digest))

    def _handed_over(
        self, prepare: PreparePolicy, files: Callable[[], dict[str, bytes]], version: int
    ) -> Agreed:
        takeover = prepare(files(), self.guide.asked)
        guide = takeover.controller.guide
        takeover.controller.guide = replace(guide, version=version, digest=guide.digest ^ takeover.digest)
        return Agreed(takeover.controller.guide, takeover)

    @property
    def _policy_digest(self) -> int:
        """By which robots that were handed a policy are told from those that run another one."""
        return self.takeover.digest if self.takeover else 0

    def _stage(self, session: int) -> tuple[Stage, str]:
        if self._proposal and self._proposal.session == session:
            return self._proposal.stage, self._proposal.complaint
        return ("applied" if self._session == session else "none"), ""


def policy_text(bundle: Bundle) -> str:
    """Say which bundle a robot runs."""
    return f"{bundle.manifest.name} {bundle.sha256[:12]}".strip()
