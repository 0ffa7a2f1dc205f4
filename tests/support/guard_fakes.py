"""A link whose firmware does what the test says, and a record of what the guard did to it."""

import math

import msgspec

from edge_runtime.errors import BridgeError
from edge_runtime.messages import RobotState
from firmware_bridge.guard.link import Condition, Health, Setpoint, SetpointLimits
from firmware_bridge.guard.spec import GuardSpec


def spec(**changes) -> GuardSpec:
    values = {
        "link": "can",
        "robot_id": 1,
        "deadline_s": 0.06,
        "limits": SetpointLimits(1.0, (-2.0, -2.0), (2.0, 2.0)),
        "options": msgspec.Raw(b"{}"),
    }
    return GuardSpec(**{**values, "arm": True, **changes})


class FakeLink:
    """Enabling takes two steps of 0.1 s, stopping two; each is logged."""

    def __init__(self, condition=Condition.READY, recoveries=0, keepalive_period_s=math.inf) -> None:
        self.firmware_timeout_s = 0.5
        self.keepalive_period_s = keepalive_period_s
        self.recoveries = recoveries
        self.condition, self.detail, self.warning = condition, "detail", ""
        self.log: list[object] = []
        self.failing: set[str] = set()
        self.stop_delay_s = 0.1
        self.newest: RobotState | None = None

    def _do(self, what, *values) -> None:
        if what in self.failing:
            raise BridgeError(f"{what} failed")
        self.log.append((what, *values) if values else what)

    def open(self) -> None:
        self._do("open")

    def close(self) -> None:
        self._do("close")

    def filenos(self) -> tuple[int, ...]:
        return (0,)

    def receive(self, now_s) -> None:
        self._do("receive")

    def health(self, now_s) -> Health:
        return Health(self.condition, self.detail, self.warning)

    def state(self) -> RobotState | None:
        return self.newest

    def dropped(self) -> int:
        return 7

    def enable_sequence(self):
        self._do("enable 1")
        yield 0.1
        self._do("enable 2")
        yield 0.1

    def send(self, setpoint: Setpoint, now_s) -> None:
        self._do("send", setpoint.sequence)

    def stop_sequence(self):
        self._do("stop 1")
        yield self.stop_delay_s
        self._do("stop 2")
        yield self.stop_delay_s

    def keepalive(self, fresh, now_s) -> None:
        self._do("keepalive", fresh)
