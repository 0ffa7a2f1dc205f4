"""Where an operator's packets are read, obeyed and answered; `orders` says what they mean."""

from typing import Final

from edge_runtime.network.datagrams import Datagram
from edge_runtime.network.order_wire import Order, decode_order, encode_answer
from edge_runtime.network.udp import Carrier
from edge_runtime.team.orders import Orders, Pace

FAREWELLS: Final = 5
"""How often a robot that ends its run says so: the answer to the stop may have been lost."""
RATE_WINDOW_S: Final = 1.0


class RateMeter:
    """Ticks per second over the last full second."""

    def __init__(self) -> None:
        self.hz = 0.0
        self._ticks, self._since_s = 0, 0.0

    def tick(self, now_s: float) -> None:
        """Count a tick."""
        passed = now_s - self._since_s
        if passed >= RATE_WINDOW_S:
            if self._ticks:
                self.hz = self._ticks / passed
            self._ticks, self._since_s = 0, now_s
        self._ticks += 1


class OrderService:
    """One robot's end of the way to its operator.

    Args:
        orders: what the robot was ordered.
        key: the operator's, and whoever else's who may order.
        carrier: takes the answers back.
        rate_hz: control rate that the robot is to keep.
    """

    def __init__(self, orders: Orders, key: bytes, carrier: Carrier, rate_hz: float) -> None:
        self.orders = orders
        self.stop_reason = "not driving yet"
        """Of the newest command, or why there is none."""
        self.at_rest = False
        """Whether the robot stands still."""
        self._key, self._carrier = key, carrier
        self._rate, self._nominal_rate_hz = RateMeter(), rate_hz
        self._tick, self._now_s = 0, 0.0
        self._newest: tuple[Order, Datagram] | None = None

    def begin(self, now_s: float, tick: int) -> None:
        """Begin a tick of the team."""
        self._now_s, self._tick = now_s, tick
        self._rate.tick(now_s)

    def handle(self, datagram: Datagram, now_s: float) -> None:
        """Obey and answer a packet.

        Raises:
            FrameError: if it is not an operator's, not for this run, or expired; it is not answered.
        """
        order = decode_order(datagram.content, self._key)
        self._now_s = now_s
        complaint = self.orders.obey(order, now_s)
        self._newest = order, datagram
        self._answer(order, datagram, complaint)

    def close(self) -> None:
        """Say once more that the run ends, if an operator ordered that."""
        if self._newest and self.orders.stop_reason:
            for _ in range(FAREWELLS):
                self._answer(*self._newest)

    def _answer(self, order: Order, datagram: Datagram, complaint: str = "") -> None:
        pace = Pace(self._tick, self._rate.hz, self._nominal_rate_hz)
        standing = self.orders.standing(
            order, complaint, self._now_s, pace, self.stop_reason, at_rest=self.at_rest
        )
        self._carrier.reply(datagram, encode_answer(standing, self._key))
