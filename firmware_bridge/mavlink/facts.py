"""Everything that an autopilot has told of itself, message by message, and what it is asked."""

from collections.abc import Iterator

from firmware_bridge.mavlink.clock import Clock
from firmware_bridge.mavlink.estimate import Estimate
from firmware_bridge.mavlink.messages import (
    Attitude,
    Content,
    EstimatorStatus,
    GpsFix,
    Heartbeat,
    Landed,
    LocalPosition,
    Odometry,
    Outgoing,
    Parameter,
    ParameterRequest,
    TimeSync,
)
from firmware_bridge.mavlink.options import MavlinkOptions
from firmware_bridge.mavlink.profiles import Profile
from firmware_bridge.mavlink.soundness import Soundness
from firmware_bridge.mavlink.vehicle import Vehicle


class Facts:
    """Takes in what arrives; sends nothing itself."""

    def __init__(self, profile: Profile, options: MavlinkOptions, robot_id: int, ahead_m: float) -> None:
        self.vehicle = Vehicle(profile)
        self.clock = Clock()
        self.estimate = Estimate(robot_id, self.clock, options.origin_m, ahead_m, options.motion.dims)
        self.soundness = Soundness(options.motion.dims)
        self._profile = profile
        self._parameters: dict[str, float] = {}

    @property
    def timeout_s(self) -> float | None:
        """Seconds without setpoints after which the firmware stops by itself, None while unknown."""
        return self._parameters.get(self._profile.timeout_parameter, self._profile.fixed_timeout_s)

    @property
    def loop_rate_hz(self) -> float | None:
        """Its scheduler's rate, None while unknown or where it does not matter."""
        rate_hz = self._parameters.get(self._profile.loop_rate_parameter)
        return rate_hz if rate_hz is None or rate_hz > 0.0 else None

    @property
    def explained(self) -> bool:
        """Whether every parameter was told."""
        return all(map(self.answered, self._names()))

    def answered(self, name: str) -> bool:
        """Whether this parameter was told."""
        return name in self._parameters

    def questions(self, now_s: float) -> Iterator[Outgoing]:
        """What is still unknown, as questions that change nothing."""
        yield self.clock.request(now_s)
        yield from (ParameterRequest(name) for name in self._names() if not self.answered(name))

    def take(self, content: Content, now_s: float) -> None:
        """Take in one message."""
        match content:
            case Heartbeat():
                self.vehicle.on_heartbeat(content, now_s)
            case Attitude():
                self.estimate.on_attitude(content)
            case LocalPosition():
                self.soundness.on_pose(content, now_s)
                self.estimate.on_local_position(content, now_s)
            case Odometry():
                self.soundness.on_pose(content, now_s)
                self.estimate.on_odometry(content, now_s)
            case EstimatorStatus():
                self.soundness.on_status(content, now_s)
            case GpsFix():
                self.soundness.on_fix(content, now_s)
            case Landed():
                self.vehicle.on_landed(content)
            case TimeSync():
                self.clock.on_answer(content, now_s)
            case Parameter():
                self._on_parameter(content)
            case _:
                pass

    def _names(self) -> Iterator[str]:
        return filter(None, (self._profile.timeout_parameter, self._profile.loop_rate_parameter))

    def _on_parameter(self, parameter: Parameter) -> None:
        # PX4 puts an integer's bytes into the float's place: what is asked of it is real.
        if parameter.real or parameter.name == self._profile.loop_rate_parameter:
            self._parameters[parameter.name] = max(parameter.value, 0.0)
