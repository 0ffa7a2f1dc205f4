"""Where a robot learns of its teammates, and tells them of itself."""

import importlib
import math
import time
from typing import Final, Protocol

from edge_runtime.common.closing import Closing
from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet
from edge_runtime.config.keys import operator_key, team_key
from edge_runtime.config.network import CarrierSettings, Endpoint, Robot, endpoint
from edge_runtime.control.bridge import Bridge
from edge_runtime.control.mission import Mission
from edge_runtime.control.start import PoseSource
from edge_runtime.errors import ConfigError
from edge_runtime.guidance.guide import Guide
from edge_runtime.messages import Command, Reading, RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.network.session import random_nonce
from edge_runtime.network.stream_wire import Kind
from edge_runtime.network.udp import Carrier, UdpCarrier
from edge_runtime.observation import Sensor
from edge_runtime.policy.manifest import Manifest
from edge_runtime.team.frame_rotation import action_axes
from edge_runtime.team.handover import PolicyReceiver, Takeover
from edge_runtime.team.link import NetworkTeam, TeamRules
from edge_runtime.team.order_service import OrderService
from edge_runtime.team.orders import Orders, policy_text
from edge_runtime.team.report import FleetReport
from edge_runtime.team.streams import FIRST_SOURCE, POSE_SOURCE, RANGES_SOURCE, Stream, Streams

STALE_PERIODS: Final = 3
"""A teammate older than this many control periods is masked."""
RECEIVING_SHARE: Final = 0.1
"""Share of the control period that receiving may take, however much arrives."""


class FleetLink(Protocol):
    """A team that is simulated in this process."""

    def teammates(self) -> tuple[Teammate, ...]:
        """Return the newest state of every teammate heard so far, with its age. Never blocks."""
        ...

    def ranges_m(self) -> tuple[float, ...] | None:
        """Return what the robot's range sensor read; None where there are only teammates to see."""
        ...

    def tracked(self) -> tuple[TrackedObject, ...]:
        """Return the fleet's tracked objects as they are now."""
        ...

    def readings(self) -> tuple[Reading, ...]:
        """Return what the robot's further sensors read."""
        ...


class TeamLink(Protocol):
    """A robot's link to its team: a context manager whose methods never block."""

    def __enter__(self) -> "TeamLink":
        """Join the team."""
        ...

    def __exit__(self, *_: object) -> None:
        """Leave it; the others will find this robot silent."""
        ...

    @property
    def stop_reason(self) -> str:
        """Why an operator ended the run; empty if none did."""
        ...

    def poses(self, bridge: Bridge) -> PoseSource | None:
        """Return what tells the poses on which the robot's ticks act; None where one is always there."""
        ...

    def receive(self) -> None:
        """Take in what has arrived, after the first tick, ahead of one that will then have less to do."""
        ...

    def locate(self, bridge: RobotState | None, due_s: float | None = None) -> RobotState | None:
        """Begin a tick: take what has arrived, and return the own state in the team's frame.

        The team's number of the tick is that of ``due_s``, its deadline in monotonic time, however late it
        begins; None: now.

        That is the bridge's where the fleet names no pose stream; None where there is none yet.
        """
        ...

    def team(self, own: RobotState) -> TeamState:
        """Return this tick's view: fresh teammates only, and a fault where no action may rest on it."""
        ...

    def new_guide(self) -> Guide | None:
        """Return what the team has agreed to follow from this tick on, once; else None."""
        ...

    def takeover(self) -> Takeover | None:
        """Return the policy that an operator handed over last; None if none was."""
        ...

    def for_base(self, command: Command) -> Command:
        """Return a command as the bridge is to take it, whose odometry may have axes of its own."""
        ...

    def share(self, own: RobotState, command: Command) -> None:
        """Tell the others of this robot's state and what it was commanded; once a tick, after the bridge."""
        ...

    def report(self) -> FleetReport | None:
        """Return what became of the frames so far; None where there are no frames."""
        ...


class Alone:
    """The teammates of a robot that has none."""

    def teammates(self) -> tuple[Teammate, ...]:
        """Return nobody."""
        return ()

    def ranges_m(self) -> None:
        """Return nothing: a real sensor's readings come as a stream."""

    def tracked(self) -> tuple[TrackedObject, ...]:
        """Return nothing: a real object's pose comes as a stream."""
        return ()

    def readings(self) -> tuple[Reading, ...]:
        """Return nothing, as for ranges."""
        return ()


class LocalTeam(Closing):
    """The team of a robot whose teammates live in this process, or that has none."""

    def __init__(self, source: FleetLink) -> None:
        self._source = source

    stop_reason = ""

    def poses(self, bridge: Bridge) -> PoseSource | None:
        """Return the bridge's."""
        return bridge.poses

    def receive(self) -> None:
        """Nothing arrives."""

    def locate(self, bridge: RobotState | None, due_s: float | None = None) -> RobotState | None:  # noqa: ARG002
        """Return the bridge's state."""
        return bridge

    def new_guide(self) -> None:
        """Return nothing: no operator reaches this robot."""

    def takeover(self) -> None:
        """Return nothing, for the same reason."""

    def for_base(self, command: Command) -> Command:
        """Return the command as it is."""
        return command

    def team(self, own: RobotState) -> TeamState:
        """Return the team as it is."""
        source = self._source
        return TeamState(
            own,
            source.teammates(),
            ranges_m=source.ranges_m(),
            tracked=source.tracked(),
            readings=source.readings(),
        )

    def share(self, own: RobotState, command: Command) -> None:
        """Tell nobody: whoever simulates the others knows already."""

    def report(self) -> None:
        """Return nothing: there are no frames."""


def open_fleet(
    mission: Mission, local: FleetLink, max_speed_m_s: float = math.inf, max_yaw_rate_rad_s: float = math.inf
) -> TeamLink:
    """Return the mission's robot's link to its team: the fleet's carrier, or ``local`` where it has none.

    Args:
        mission: the robot's.
        local: its team where there is no network.
        max_speed_m_s: greatest velocity setpoint that its bridge takes.
        max_yaw_rate_rad_s: greatest yaw rate that it takes.

    Raises:
        ConfigError: if the key cannot be used, this machine does not have the robot's address, or a robot
            that is not alone would not hear of the others.
    """
    fleet = mission.fleet
    if fleet.carrier is None:
        if isinstance(local, Alone):
            _check_alone(mission)
        return LocalTeam(local)
    settings = fleet.carrier
    key = team_key(fleet)
    endpoints = {robot.id: endpoint(robot.address) for robot in fleet.robots if robot.address is not None}
    own = endpoints.pop(mission.robot_id)
    rules, robot = _rules(mission, settings, tuple(endpoints)), fleet.robot(mission.robot_id)
    others = tuple(endpoints)
    sources = {POSE_SOURCE: robot.pose_place, RANGES_SOURCE: robot.ranges_place}
    further = (*(each.pose_place for each in fleet.tracked), *robot.sensor_places.values())
    sources |= {FIRST_SOURCE - index: place for index, place in enumerate(further)}
    endpoints |= {source: place for source, place in sources.items() if place}
    carrier = _carrier(mission, settings, own, endpoints)
    orders = Orders(
        mission.robot_id,
        random_nonce(),
        mission.guide(),
        mission.guide_of,
        PolicyReceiver(mission, max_speed_m_s, max_yaw_rate_rad_s),
        policy_text(mission.bundle),
    )
    service = OrderService(orders, operator_key(fleet), carrier, mission.rate_hz)
    streams = _streams(fleet, robot, mission.bundle.manifest, key, carrier)
    return NetworkTeam(mission.robot_id, others, rules, carrier, key, service, streams, time.monotonic)


def _check_alone(mission: Mission) -> None:
    """Refuse what a robot without a network could not see, or only a simulated one."""
    fleet = mission.fleet
    if len(fleet.robots) > 1:
        refuse(fleet.path, "carrier", "missing: a robot of this team would drive blind beside the others")
    if fleet.tracked:
        refuse(fleet.path, "carrier", "missing: it brings the poses of what [[tracked]] names")
    if any(isinstance(field, Sensor) for field in mission.bundle.manifest.observation):
        refuse(
            fleet.path, "carrier", "missing: it brings the readings of the sensors that the policy observes"
        )
    if fleet.obstacles:
        refuse(fleet.path, "obstacle", "means nothing on a real robot; take it away, or use --bridge sim")
    for objective in mission.objectives:
        if objective.sight_m:
            refuse(fleet.path, "carrier", f"missing: it brings the ranges that {objective.name} needs to see")


def _carrier(
    mission: Mission, settings: CarrierSettings, own: Endpoint, endpoints: dict[int, Endpoint]
) -> Carrier:
    fleet = mission.fleet
    try:
        udp = UdpCarrier(own, endpoints)
    except ConfigError as error:
        refuse(fleet.path, f"robots[{_index(fleet, mission.robot_id)}].address", str(error))
    if settings.type == "udp":
        return udp
    zenoh = importlib.import_module("edge_runtime.network.zenoh")  # only where wanted: it loads TLS
    try:
        carrier: Carrier = zenoh.open_zenoh(fleet, settings, mission.robot_id, udp)
    except ConfigError as error:
        udp.close()
        refuse(fleet.path, "", str(error))
    return carrier


def _streams(fleet: Fleet, robot: Robot, manifest: Manifest, key: bytes, carrier: Carrier) -> Streams:
    pose = ranges = axes = None
    dims = manifest.motion.dims
    if robot.pose_place:
        values = (2 * dims + 2,)
        pose = Stream(POSE_SOURCE, robot.id, Kind.POSE_REQUEST, Kind.POSE, values, key, carrier)
        axes = action_axes(manifest)
    rays = (manifest.body.lidar_rays,)
    if robot.ranges_place:
        ranges = Stream(RANGES_SOURCE, robot.id, Kind.RANGES_REQUEST, Kind.RANGES, rays, key, carrier)
    objects, sensors = [], []
    motions = [2 * told + 2 for told in (2, 3) if told >= dims]
    for index, each in enumerate(fleet.tracked):
        kinds = (Kind.OBJECT_REQUEST, Kind.OBJECT)
        stream = Stream(FIRST_SOURCE - index, robot.id, *kinds, motions, key, carrier, each.name)
        objects.append((stream, each.goal_m))
    for index, name in enumerate(robot.sensors, len(fleet.tracked)):
        kinds = (Kind.SENSOR_REQUEST, Kind.SENSOR)
        sensors.append(Stream(FIRST_SOURCE - index, robot.id, *kinds, None, key, carrier, name))
    return Streams(robot.id, pose, ranges, key, objects, sensors, axes, dims)


def _rules(mission: Mission, settings: CarrierSettings, others: tuple[int, ...]) -> TeamRules:
    manifest = mission.bundle.manifest
    neighbours = mission.fleet.robot(mission.robot_id).neighbours
    neighbours = others if neighbours is None else neighbours
    return TeamRules(
        neighbours=neighbours,
        nearest=min(settings.nearest or len(neighbours), len(neighbours)),
        stale_s=STALE_PERIODS * mission.period_s,
        alone_s=settings.alone_s,
        missing_s=settings.missing_s,
        receiving_s=RECEIVING_SHARE * mission.period_s,
        period_s=mission.period_s,
        dims=manifest.motion.dims,
        action_dim=manifest.action_dim,
    )


def _index(fleet: Fleet, robot_id: int) -> int:
    return [robot.id for robot in fleet.robots].index(robot_id)
