"""A team of processes: frames and orders in before each tick, frames out after it."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from edge_runtime.common.closing import Closing
from edge_runtime.control.bridge import Bridge
from edge_runtime.control.start import PoseSource
from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import Command, RobotState, Teammate, TeamState
from edge_runtime.network.datagrams import Datagram
from edge_runtime.network.seal import DOUBTS, FrameError, Magic, Refusal
from edge_runtime.network.session import random_nonce
from edge_runtime.network.team_wire import decode, encode
from edge_runtime.network.udp import Carrier
from edge_runtime.team.handover import Takeover
from edge_runtime.team.order_service import OrderService
from edge_runtime.team.peer import Peer
from edge_runtime.team.report import FleetReport, Traffic
from edge_runtime.team.streams import Stream, Streams
from edge_runtime.team.tick import TeamTick

REST_M_S: Final = 0.05
"""Slower is at rest: no odometry says zero."""


class TeamRules(msgspec.Struct, frozen=True):
    """To whom a robot listens, and what it does when they fall silent."""

    neighbours: tuple[int, ...]
    """Ids of those it may listen to."""
    nearest: int
    """It listens to so many of them; at most all."""
    stale_s: float
    """An older teammate is masked; it stays an obstacle where it was."""
    alone_s: float
    """How long it drives on while it hears nobody."""
    missing_s: float
    """How long it drives on without any one of those that it listens to."""
    receiving_s: float
    """How long a tick takes in packets once it has had a few from everybody: what a flood may cost."""
    period_s: float
    """The control period."""
    dims: int = 2
    """Components of every robot's position."""
    action_dim: int = 2
    """Components of every robot's action."""


class NetworkTeam(Closing):
    """One robot's link to a team of processes.

    It tells those that it listens to, those that listen to it, and those that ask to join; where it
    listens to the nearest only, one more robot in turn, so that all learn who comes near.

    Args:
        robot_id: of this robot.
        others: ids of all other robots of the fleet.
        rules: to whom it listens.
        carrier: takes the packets to them; closed on leaving the context.
        key: the team's.
        service: takes the operator's orders.
        streams: tell the robot's own pose and ranges.
        clock: monotonic time in seconds.
        nonce: draws the boot id and the challenges.
    """

    def __init__(
        self,
        robot_id: int,
        others: Sequence[int],
        rules: TeamRules,
        carrier: Carrier,
        key: bytes,
        service: OrderService,
        streams: Streams,
        clock: Callable[[], float],
        nonce: Callable[[], int] = random_nonce,
    ) -> None:
        self._robot_id, self._rules, self._carrier, self._key = robot_id, rules, carrier, key
        self._service, self._orders, self._streams = service, service.orders, streams
        self._clock, self._boot_id, self._sequence = clock, nonce(), 0
        self._peers = {other: Peer(other, nonce) for other in others}
        self._turn = tuple(others) if rules.nearest < len(rules.neighbours) else ()
        self._wanted: frozenset[int] = frozenset(rules.neighbours)
        self._fair_share = 4 * len(others)
        self._body = rules.dims, rules.action_dim
        self._traffic = Traffic()
        self._tick = TeamTick(rules.period_s)
        self._guide_tick, self._new_guide, self._agreed = 0, False, False

    def close(self) -> None:
        """Leave the team."""
        self._service.close()
        self._carrier.close()

    @property
    def stop_reason(self) -> str:
        """Why an operator ended the run; empty if none did."""
        return self._orders.stop_reason

    @property
    def tick(self) -> int:
        """The team's newest tick."""
        return self._tick.number

    def poses(self, bridge: Bridge) -> PoseSource | None:
        """Return what tells the robot's poses: its stream, or the bridge."""
        return StreamedPoses(self, self._carrier, self._streams.pose) if self._streams.pose else bridge.poses

    def receive(self) -> None:
        """Take in what has arrived; after the first tick."""
        self._receive(self._clock())

    def locate(self, bridge: RobotState | None, due_s: float | None = None) -> RobotState | None:
        """Begin a tick: take what has arrived, and return the own state as the fleet wants it."""
        now = self._clock()
        self._tick.advance(now if due_s is None else due_s)
        self._service.begin(now, self._tick.number)
        self._receive(now)
        self._streams.ask(now)
        if self._orders.change(self._tick.number):
            self._guide_tick, self._new_guide = self._tick.number, True
        located = self._streams.locate(bridge) if bridge else None
        if located is None:
            self._service.stop_reason = self._streams.fault(now) or "waits for the bridge's first state"
        return located

    def new_guide(self) -> Guide | None:
        """Return what the robot follows from now on, once after each change."""
        changed, self._new_guide = self._new_guide, False
        return self._orders.guide if changed else None

    def takeover(self) -> Takeover | None:
        """Return the policy that was handed over last; None if none was."""
        return self._orders.takeover

    def team(self, own: RobotState) -> TeamState:
        """Return this tick's view of the team."""
        now, rules = self._clock(), self._rules
        neighbours = [self._peers[other] for other in rules.neighbours]
        heard = [peer.teammate(now) for peer in neighbours if peer.newest is not None]
        heard.sort(key=lambda mate: math.dist(own.position_m, mate.state.position_m))
        fresh = [mate for mate in heard if mate.age_s <= rules.stale_s]
        near, used = heard[: rules.nearest], fresh[: rules.nearest]
        unheard = [peer.robot_id for peer in neighbours if peer.newest is None]
        joining = unheard if len(near) < rules.nearest else ()
        self._wanted = frozenset((*(mate.state.robot_id for mate in (*near, *used)), *joining))
        for mate in used:
            self._traffic.used_ages.add(mate.age_s)
        silent = tuple(_at_rest(mate) for mate in near if mate.age_s > rules.stale_s)
        self._traffic.masked.update(mate.state.robot_id for mate in silent)
        used.sort(key=lambda mate: mate.state.robot_id)
        fault = self.stop_reason or self._orders.pause(now)
        fault = fault or self._streams.fault(now) or self._fault(heard, near, unheard)
        streams = self._streams
        tracked, readings = streams.tracked(now), streams.readings()
        return TeamState(own, tuple(used), fault, streams.ranges_m(), silent, tracked, readings)

    def for_base(self, command: Command) -> Command:
        """Return the command as the bridge is to take it."""
        return self._streams.for_base(command)

    def share(self, own: RobotState, command: Command) -> None:
        """Send this tick's frames."""
        self._sequence += 1
        self._service.stop_reason = command.stop_reason
        self._service.at_rest = bool(command.stop_reason) and math.hypot(*own.velocity_m_s) <= REST_M_S
        versions = self._orders.versions()
        for robot_id in self._audience():
            frame = self._peers[robot_id].frame(
                self._boot_id,
                self._sequence,
                own,
                command.action,
                self._tick.number,
                versions,
                listens=robot_id in self._wanted,
            )
            self._carrier.send(robot_id, encode(frame, self._key))
            self._traffic.sent += 1

    def report(self) -> FleetReport:
        """Sum up the traffic so far."""
        heard = {robot_id: peer.newest for robot_id, peer in self._peers.items()}
        versions = {robot_id: frame.versions.version for robot_id, frame in heard.items() if frame}
        return self._traffic.report(self._carrier.failures, versions, self._orders.guide.version)

    def _receive(self, now_s: float) -> None:
        for taken, datagram in enumerate(self._carrier.receive(), 1):
            try:
                if datagram.content.startswith(Magic.ORDER):
                    self._service.handle(datagram, now_s)
                elif datagram.content.startswith(Magic.STREAM):
                    self._streams.handle(datagram)
                else:
                    self._admit(datagram, now_s)
            except FrameError as error:
                self._traffic.refused[error.cause.value] += 1
            if taken >= self._fair_share and self._clock() > now_s + self._rules.receiving_s:
                break

    def _admit(self, datagram: Datagram, now_s: float) -> None:
        frame = decode(datagram.content, self._key)
        peer = self._peers.get(frame.state.robot_id)
        if peer is None or frame.receiver != self._robot_id:
            raise FrameError(Refusal.MISDIRECTED)
        if datagram.sender not in (None, peer.robot_id):
            raise FrameError(Refusal.IMPERSONATED)
        try:
            if (len(frame.state.position_m), len(frame.intended_action)) != self._body:
                raise FrameError(Refusal.OTHER_BODY)
            peer.check(frame, datagram.arrival_s)
            self._tick.hear(peer.robot_id, frame.tick, now_s)
        except FrameError as error:
            if error.cause in DOUBTS:
                peer.doubt = error.cause.value
                self._traffic.doubted[peer.robot_id] += 1
            raise
        peer.accept(frame, datagram.arrival_s)
        self._orders.heard(frame.versions, self._tick.number)
        self._traffic.accepted += 1
        self._traffic.message_ages.add(peer.age_s(now_s))

    def _audience(self) -> set[int]:
        audience = set(self._wanted)
        for robot_id, peer in self._peers.items():
            listens = peer.newest is not None and peer.newest.listens
            joins = peer.newest is None and peer.answer != 0
            if listens or joins:
                audience.add(robot_id)
        if self._turn:
            audience.add(self._turn[self._sequence % len(self._turn)])
        return audience

    def _fault(self, heard: Sequence[Teammate], near: Sequence[Teammate], unheard: Sequence[int]) -> str:
        rules = self._rules
        if len(near) < rules.nearest:
            return f"waits for robots {', '.join(map(str, unheard))}: not heard yet{self._doubts(unheard)}"
        if other := self._disagreement(near):
            return other
        if heard and min(mate.age_s for mate in heard) > rules.alone_s:
            return f"no teammate was heard for {rules.alone_s:g} s"
        for mate in near:
            if mate.age_s > rules.missing_s:
                robot_id = mate.state.robot_id
                return f"robot {robot_id} was not heard for {rules.missing_s:g} s{self._doubts([robot_id])}"
        return ""

    def _doubts(self, silent: Sequence[int]) -> str:
        """Name those of the silent whose frames come, and are not believed."""
        told = {robot_id: doubt for robot_id in silent if (doubt := self._peers[robot_id].doubt)}
        return "".join(f"; robot {robot_id} is kept out: {doubt}" for robot_id, doubt in told.items())

    def _disagreement(self, near: Sequence[Teammate]) -> str:
        """Count who follows other objectives; a reason not to drive only until all have once agreed."""
        own = self._orders.versions()
        differing = [
            mate.state.robot_id
            for mate in near
            if (newest := self._peers[mate.state.robot_id].newest)
            and newest.tick >= self._guide_tick  # an older frame is of the time before our change
            and newest.versions.digest not in (own.digest, own.next_digest)
        ]
        self._traffic.disagreed.update(differing)
        self._agreed = self._agreed or not differing
        if self._agreed:
            return ""
        return f"robot {differing[0]} follows other objectives than this one"


class StreamedPoses:
    """The poses of a stream, see `edge_runtime.control.start.PoseSource`."""

    def __init__(self, team: NetworkTeam, carrier: Carrier, stream: Stream) -> None:
        self._team, self._stream = team, stream
        self.fileno = carrier.fileno

    def new_poses(self) -> Sequence[float]:
        """Take in what has arrived; returns when each new pose was measured."""
        self._team.receive()
        return self._stream.stamps()


def _at_rest(mate: Teammate) -> Teammate:
    """Return a teammate that was silent too long: where it was, without what it intended then."""
    state = mate.state
    resting = replace(state, velocity_m_s=(0.0,) * len(state.velocity_m_s), yaw_rate_rad_s=0.0)
    return Teammate(resting, (0.0,) * len(mate.intended_action), mate.age_s)
