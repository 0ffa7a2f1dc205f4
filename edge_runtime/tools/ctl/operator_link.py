"""An operator's end of the way to all robots of a team: every order is repeated until it is answered."""

import contextlib
import time
from collections.abc import Callable, Mapping
from functools import partial
from statistics import median_low
from typing import Final

from edge_runtime.common.closing import Closing
from edge_runtime.common.printable import printed
from edge_runtime.config.network import Endpoint
from edge_runtime.network.datagrams import speak
from edge_runtime.network.order_wire import (
    FILE_BYTES,
    PACKET_BYTES,
    Abort,
    Ask,
    Chunk,
    Commit,
    Halt,
    Offer,
    Order,
    Propose,
    Standing,
    Stop,
    decode_answer,
    encode_order,
)
from edge_runtime.network.seal import FrameError
from edge_runtime.network.session import random_nonce

RETRY_S: Final = 0.04
"""Time between two repetitions."""
ASK_AGAIN: Final = 8
"""After so many repetitions without an answer comes an `Ask`: the robot may have started anew."""
VALID_S: Final = 1.0
"""How long a robot obeys an order after it was sent."""

WINDOW: Final = 4
"""Chunks on the way to one robot: what its socket holds beside its team's frames."""
RESEND_S: Final = 0.25
"""After so long without a word chunks are sent again: a slow robot takes in packets every 100 ms."""
CHECK_S: Final = 20.0
"""More time for a robot to write, check and load a policy."""
REST_S: Final = 5.0
"""More time for a robot to come to rest."""

MakeOrder = Callable[[int, int, int, int, float], Order]
"""Of session, number, receiver, boot id and expiry."""
Settled = Callable[[Standing], bool]


class OperatorLink(Closing):
    """A session with a team.

    Args:
        robots: where each one listens, by id.
        key: the operator's.
        timeout_s: how long to repeat an order before a robot counts as silent.
    """

    def __init__(self, robots: Mapping[int, Endpoint], key: bytes, timeout_s: float) -> None:
        self.standings: dict[int, Standing] = {}
        """Each robot's newest answer."""
        self.session = random_nonce()
        self._robots, self._key, self._timeout_s = robots, key, timeout_s
        self._heard_s: dict[int, float] = {}
        self._number = 0
        self._datagrams = speak(next(iter(robots.values()))[0], PACKET_BYTES)

    def close(self) -> None:
        """Give the network back; robots keep what they were ordered."""
        self._datagrams.close()

    def ask(self) -> list[int]:
        """Ask all for their standing; return who is silent."""
        asked = self._number
        return self._until(Ask, lambda standing: standing.number > asked)

    def await_driving(self) -> list[int]:
        """Wait until no robot's command is zero for a reason of its own; return who still stands."""
        return self._until(Ask, lambda standing: not standing.stop_reason)

    def propose(self, version: int, file: str, content: bytes) -> list[int]:
        """Have all check objectives, until one refuses or all have answered; return who has not accepted."""
        order = partial(Propose, version=version, file=file, content=content)
        return self._until(order, lambda standing: standing.stage == "accepted", self._refused)

    def offer(self, version: int, files: Mapping[str, bytes]) -> list[int]:
        """Have all take in the files of a policy and check them; return who has not accepted.

        Robots take in what follows without a gap, and say how far they have come: a few chunks are on the way
        to each at a time, so that neither its team's frames nor its tick wait for them.
        """
        sizes = tuple((name, len(content)) for name, content in files.items())
        order = partial(Offer, version=version, files=sizes)
        begun = self._until(order, lambda standing: standing.stage not in ("none", "refused"), self._refused)
        if begun:
            return begun
        stream = b"".join(files.values())
        waiting = self._transfer(stream)
        if waiting:
            return waiting
        return self._until(Ask, lambda standing: standing.stage == "accepted", self._refused, more_s=CHECK_S)

    def _transfer(self, stream: bytes) -> list[int]:
        """Send what each robot lacks until all have everything; return who has not come on for too long."""
        moved_s = dict.fromkeys(self._robots, time.monotonic())
        sent_s = dict.fromkeys(self._robots, 0.0)
        reached = dict.fromkeys(self._robots, -1)
        while lacking := [robot for robot in self._robots if not self._is(robot, _has_all)]:
            if self._refused():
                return lacking
            now_s = time.monotonic()
            for robot_id in lacking:
                received = self.standings[robot_id].received
                if received > reached[robot_id]:
                    reached[robot_id], moved_s[robot_id] = received, now_s
                elif now_s < sent_s[robot_id] + RESEND_S:
                    continue
                sent_s[robot_id] = now_s
                for begin in range(received, min(received + WINDOW * FILE_BYTES, len(stream)), FILE_BYTES):
                    content = stream[begin : begin + FILE_BYTES]
                    self._send(robot_id, partial(Chunk, offset=begin, content=content))
            self._receive(RETRY_S)
            late = [robot for robot in lacking if time.monotonic() - moved_s[robot] > self._timeout_s]
            if late:
                return late
        return []

    def halt(self) -> list[int]:
        """Have all stand; return who does not come to rest."""
        return self._until(Halt, lambda standing: standing.at_rest, more_s=REST_S)

    def commit(self, tick: int) -> list[int]:
        """Commit what was proposed to a tick of the team; return who has not confirmed."""
        order = partial(Commit, tick=tick)
        return self._until(order, lambda standing: standing.stage in ("committed", "applied"))

    def applied(self, lead_s: float) -> list[int]:
        """Wait until all follow what was committed to a tick in ``lead_s``; return who does not."""
        return self._until(Ask, lambda standing: standing.stage == "applied", more_s=lead_s)

    def abort(self) -> list[int]:
        """Take back what was proposed; return who has not confirmed."""
        asked = self._number
        return self._until(Abort, lambda standing: standing.number > asked and standing.stage != "accepted")

    def stop(self) -> list[int]:
        """Stop all; return who has not confirmed."""
        return self._until(Stop, lambda standing: standing.stopped)

    def tick_in(self, seconds: float) -> int:
        """Return the number of the team's tick in so many seconds; somebody must have answered.

        Robots in order differ by a tick or two; what one that is not says must not put off a change for ever.
        """
        now = time.monotonic()
        return median_low(
            standing.tick + round((now + seconds - self._heard_s[robot_id]) * standing.nominal_rate_hz)
            for robot_id, standing in self.standings.items()
        )

    def _refused(self) -> bool:
        return any(standing.stage == "refused" for standing in self.standings.values())

    def _until(
        self,
        make: MakeOrder,
        settled: Settled,
        enough: Callable[[], bool] = lambda: False,
        more_s: float = 0.0,
    ) -> list[int]:
        """Repeat an order to whom it has not settled, until all are, ``enough`` says so, or time is up."""
        end_s, repeated = time.monotonic() + self._timeout_s + more_s, 0
        while True:
            silent = [robot for robot in self._robots if not self._is(robot, settled)]
            if not silent or enough() or time.monotonic() >= end_s:
                return silent
            repeated += 1
            for robot_id in silent:
                self._send(robot_id, make if repeated % ASK_AGAIN else Ask)
            self._receive(RETRY_S)

    def _is(self, robot_id: int, settled: Settled) -> bool:
        return robot_id in self.standings and settled(self.standings[robot_id])

    def _send(self, robot_id: int, make: MakeOrder) -> None:
        self._number += 1
        standing = self.standings.get(robot_id)
        if standing is None:
            order: Order = Ask(self.session, self._number, robot_id, 0, 0.0)
        else:
            expires_s = standing.stamp_s + time.monotonic() - self._heard_s[robot_id] + VALID_S
            order = make(self.session, self._number, robot_id, standing.boot_id, expires_s)
        # What does not get out is as good as lost: it is repeated, and who stays silent is named.
        self._datagrams.send(encode_order(order, self._key), self._robots[robot_id])

    def _receive(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            self._datagrams.wait(left_s)
            for datagram in self._datagrams.receive():
                with contextlib.suppress(FrameError):  # somebody else's packet
                    self._take(decode_answer(datagram.content, self._key), datagram.arrival_s)

    def _take(self, standing: Standing, arrival_s: float) -> None:
        known = self.standings.get(standing.robot_id)
        newer = known is None or standing.number >= known.number
        if standing.session == self.session and standing.robot_id in self._robots and newer:
            self.standings[standing.robot_id] = standing
            self._heard_s[standing.robot_id] = arrival_s
            self.standings[standing.robot_id] = printed(standing)
            self._heard_s[standing.robot_id] = time.monotonic()


def _has_all(standing: Standing) -> bool:
    """Whether a robot has all chunks: it goes on to check them."""
    return standing.stage in ("checking", "accepted", "committed")
