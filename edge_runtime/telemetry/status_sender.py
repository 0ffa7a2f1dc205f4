"""A robot's side of being watched: a few times a second it sends its status, and never reads an answer.

The loop itself sends, after its command is out: a status costs it a fraction of a millisecond of the time
that it would sleep, where a thread would take the interpreter's lock at a moment of its own choosing.
"""

import math
import time
from collections.abc import Callable
from typing import Final, Protocol

from msgspec.structs import replace

from edge_runtime.config.keys import team_key
from edge_runtime.config.network import Endpoint, endpoint
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.control.rate import DeadlineGrid, TimingRecord
from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import Command, GuidedAction, TeamState, Vector
from edge_runtime.network.datagrams import speak
from edge_runtime.telemetry.status import LONGEST, ObjectiveStatus, Span, Status, encode

RATE_HZ: Final = 5.0
FAREWELLS: Final = 3
"""How often a robot says that its run is over: packets are lost."""
WINDOW_S: Final = 2.0
"""Durations are those of so much time before a status."""
LONGEST_TEXT: Final = 200


class Watch(Protocol):
    """Whom a robot tells of itself."""

    def adopt(self, guide: Guide) -> None:
        """Take note of what steers from here on."""
        ...

    def tell(self, team: TeamState, guided: GuidedAction, command: Command) -> None:
        """Take note of one tick, after its command is out. Never blocks."""
        ...

    def end(self, reason: str) -> None:
        """Say that the run is over, and why."""
        ...

    def close(self) -> None:
        """Give the network back."""
        ...


class Unwatched:
    """Nobody."""

    def adopt(self, guide: Guide) -> None:
        """Tell nobody."""

    def tell(self, team: TeamState, guided: GuidedAction, command: Command) -> None:
        """Tell nobody."""

    def end(self, reason: str) -> None:
        """Tell nobody."""

    def close(self) -> None:
        """Nothing needs closing."""


class StatusSender:
    """Sends one robot's status to one address.

    Args:
        mission: the robot's.
        monitor: of its run.
        grid: of its run.
        timing: of its run.
        address: the watcher's.
        key: the team's.
        clock: monotonic time in seconds.
    """

    def __init__(
        self,
        mission: Mission,
        monitor: Monitor,
        grid: DeadlineGrid,
        timing: TimingRecord,
        address: Endpoint,
        key: bytes,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._mission, self._monitor, self._grid, self._timing = mission, monitor, grid, timing
        self._address, self._key, self._clock = address, key, clock
        self._window_ticks = max(1, round(WINDOW_S * mission.rate_hz))
        self._started_s, self._sequence, self._due_s = time.time(), 0, clock()
        self._newest: Status | None = None
        self.adopt(mission.guide())
        self._datagrams = speak(address[0], LONGEST)
        self.failures = self._datagrams.failures
        """Statuses that could not be sent, by the system's name of the cause: the robot does not mind."""

    def adopt(self, guide: Guide) -> None:
        """Take note of what steers from here on."""
        self._version = guide.version
        self._asked = [(item.name, item.asks) for item in guide.objectives]
        self._wanted = guide.asked  # judged also where the flow is left alone

    def tell(self, team: TeamState, guided: GuidedAction, command: Command) -> None:
        """Send a status if it is time to. Never blocks, never raises what the network does."""
        now = self._clock()
        if now < self._due_s:
            return
        self._due_s = max(self._due_s + 1.0 / RATE_HZ, now)
        self._newest = self._status(team, guided, command)
        self._send(self._newest)

    def end(self, reason: str) -> None:
        """Say a few times that the run is over; nothing where it never came to a first status."""
        if self._newest is None:
            return
        last = replace(self._newest, sent_s=time.time(), ended=reason[:LONGEST_TEXT])
        for _ in range(FAREWELLS):
            self._send(last)

    def _send(self, status: Status) -> None:
        self._sequence += 1
        packet = encode(replace(status, sequence=self._sequence), self._key)
        self._datagrams.send(packet, self._address)

    def close(self) -> None:
        """Close the socket."""
        self._datagrams.close()

    def _status(self, team: TeamState, guided: GuidedAction, command: Command) -> Status:
        monitor, grid, own = self._monitor, self._grid, team.own
        *stages, tick = (Span(*pair) for pair in self._timing.recent_us(self._window_ticks))
        steps = max(1, guided.steps)
        results = zip(self._asked, guided.costs, guided.conflicts, strict=False)  # none in a stopped tick
        return Status(
            robot_id=own.robot_id,
            started_s=self._started_s,
            sequence=self._sequence,
            sent_s=time.time(),
            position_m=_known_place(own.position_m),
            velocity_m_s=_known_place(own.velocity_m_s),
            heading_rad=_known(own.heading_rad),
            yaw_rate_rad_s=_known(own.yaw_rate_rad_s),
            action=command.action,
            speed_limit_m_s=self._wanted.speed_limit_m_s,
            goal_distance_m=_known(monitor.robots[own.robot_id].goal_distance_m),
            nearest_m=_known(
                min(
                    (math.dist(own.position_m, mate.state.position_m) for mate in team.teammates),
                    default=math.inf,
                )
            ),
            margin_m=self._wanted.margin_m,
            rate_hz=grid.rate_hz,
            nominal_rate_hz=self._mission.rate_hz,
            missed=grid.misses,
            cut_short=monitor.anytime_ticks,
            tick=tick,
            stages=dict(zip(self._timing.stages, stages, strict=True)),
            objectives=tuple(
                ObjectiveStatus(name, limit, cost, conflicts / steps)
                for (name, limit), cost, conflicts in results
            ),
            objectives_version=self._version,
            ages_s={mate.state.robot_id: mate.age_s for mate in team.teammates},
            stop_reason=command.stop_reason[:LONGEST_TEXT],
            unfamiliar=monitor.unfamiliar_now[:LONGEST_TEXT],
            unfamiliar_ticks=monitor.unfamiliar.total(),
        )


def _known(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _known_place(place: Vector) -> Vector | None:
    return place if all(map(math.isfinite, place)) else None


def open_watch(mission: Mission, monitor: Monitor, grid: DeadlineGrid, timing: TimingRecord) -> Watch:
    """Return whom the mission's robot tells of itself: the fleet file's ``[watch]``, or nobody.

    Raises:
        ConfigError: if the team's key cannot be used.
    """
    fleet = mission.fleet
    if fleet.watch is None or fleet.carrier is None:
        return Unwatched()
    return StatusSender(mission, monitor, grid, timing, endpoint(fleet.watch.address), team_key(fleet))
