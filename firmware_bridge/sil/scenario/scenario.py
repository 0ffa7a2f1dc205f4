"""One run of ``edge-sil``, put together from its flags and files, and checked before anything starts."""

import importlib.util
import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec.structs import replace

from edge_runtime.common.realtime import PRIORITY
from edge_runtime.common.toml_file import Table, read_toml, refuse
from edge_runtime.config.fleet import Fleet, fleet_from, load_fleet
from edge_runtime.config.network import Robot
from edge_runtime.control.mission import adapted
from edge_runtime.errors import BundleError, ConfigError
from edge_runtime.messages import Vector2
from edge_runtime.motion.point import PointForce
from edge_runtime.policy.bundle import Bundle, load_bundle, packaged_bundle
from edge_runtime.policy.bundle_source import located
from firmware_bridge.sil.scenario.faults import AnyFault, ClockJump, NetworkFault, load_faults
from firmware_bridge.sil.scenario.limits import DEFAULT_LIMITS, LimitsFile, load_limits
from firmware_bridge.sil.scenario.ports import Network, Tunnel, free_network, multicast_bus
from firmware_bridge.sil.scenario.ros_place import RosPlace, check_ros, free_ros
from firmware_bridge.sil.scenario.team_file import (
    generated_team,
    on_zenoh,
    resolved,
    task_team,
    with_ranges,
    with_streams,
    write_fleets,
    write_key,
)
from firmware_bridge.sil.scenario.vehicle import ROS, BridgeKind, Vehicle, ros_folders, vehicle
from firmware_bridge.simulation.plants import check_installed
from firmware_bridge.simulation.wheels.fit import check_fleet

ROBOTS = 4
GUARD_PERIODS = 3
"""The guard's deadline in control periods, its own default where that is at most 0.1 s."""


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """The flags, as parsed."""

    robots: int | None = None
    """None: the fleet file's, or `ROBOTS`."""
    bridge: BridgeKind = "can"
    plant: str | None = None
    """What moves the robots, see `firmware_bridge.simulation.plants`; None: the fleet's."""
    ros_path: tuple[str, ...] = ()
    """Where rospy or rclpy lies; empty: where the profile says."""
    rate_hz: float = 50.0
    duration_s: float = 30.0
    fleet: Path | None = None
    task: str | None = None
    """A packaged fleet file instead, see `edge_runtime.config.fleet.TASKS`."""
    policy: Path | None = None
    faults: Path | None = None
    limits: Path = DEFAULT_LIMITS
    realtime: bool = False
    log_dir: Path | None = None
    pose_hz: float = 0.0
    """Of a stream that tells the robots their poses; 0: their firmware does."""


class Station(msgspec.Struct, frozen=True):
    """Where one robot's processes find everything."""

    robot_id: int
    fleet_file: str
    wire: str
    """CAN: the bus's address; MAVLink: the firmware's port; ROS: the namespace."""
    port: int
    """Where it hears its team."""
    start_m: Vector2
    goal_m: Vector2 | None
    heading_rad: float
    vehicle: Vehicle


@dataclass(frozen=True)
class Scenario:
    """A run, ready to be started."""

    request: Request
    fleet: Fleet
    bundle: Bundle
    stations: tuple[Station, ...]
    relays: tuple[tuple[int, int], ...]
    """(robot id, port) of each robot's relay; none where the network has no faults, and none on Zenoh."""
    tunnels: tuple[Tunnel, ...]
    """On Zenoh, those between all pairs of robots where the network has faults."""
    faults: tuple[AnyFault, ...]
    limits: LimitsFile
    ros: RosPlace
    """Of the run's own ROS, where it has one."""
    folder: Path
    """For everything that the run writes and nobody keeps."""

    @property
    def period_s(self) -> float:
        """The control period."""
        return 1.0 / self.request.rate_hz


def prepare(request: Request, folder: Path) -> Scenario:
    """Check a request and write its fleet files.

    Raises:
        EdgeError: one line that says what does not hold together.
    """
    limits = load_limits(request.limits)
    table = _team_table(request, folder)
    robots = tuple(robot["id"] for robot in table["robots"])
    faults = load_faults(request.faults, robots, request.duration_s, request.bridge) if request.faults else ()
    _check_rights(request, faults)
    relayed = any(isinstance(fault, NetworkFault) for fault in faults)
    network = free_network(robots, zenoh=on_zenoh(table), relayed=relayed)
    # A guard opens no robot of ROS that tells no odometry. Nobody may drive before all are there: their poses
    # come in a stream, which begins then.
    streamed = request.pose_hz > 0.0 or request.bridge in ROS
    table = with_streams(table, network.stream, wanted=streamed)
    obstacles = fleet_from(table, request.fleet).obstacles if request.fleet else ()
    if obstacles:  # no robot knows of them: each sees them
        table = with_ranges({key: value for key, value in table.items() if key != "obstacle"}, network.stream)
    files = write_fleets(table, robots, network, folder)
    fleet = replace(load_fleet(files[robots[0]]), obstacles=obstacles)
    if request.limits == DEFAULT_LIMITS and any(each.goal_m for each in fleet.tracked):
        # Who carries something together touches it, and each other.
        limits = replace(limits, run=replace(limits.run, collisions=None))
    bundles = [robot_bundle(fleet, robot, str(request.policy or "")) for robot in fleet.robots]
    _check_plant(fleet, bundles)
    stations = tuple(
        _station(robot, files[robot.id], network, request.bridge, _driven(request.bridge, bundle, fleet))
        for robot, bundle in zip(fleet.robots, bundles, strict=True)
    )
    relays = tuple(network.relays.items())
    tunnels = tuple(
        Tunnel(one, other, port, network.zenoh[other]) for (one, other), port in network.tunnels.items()
    )
    ros = _ros_place(request, folder)
    return Scenario(request, fleet, bundles[0], stations, relays, tunnels, faults, limits, ros, folder)


def _ros_place(request: Request, folder: Path) -> RosPlace:
    """Find a place for the run's own ROS, where it speaks one.

    Raises:
        ConfigError: if that ROS is not installed.
    """
    if request.bridge not in ROS:
        return RosPlace()
    kind = ROS[request.bridge]
    check_ros(kind.library, ros_folders(request.bridge, request.ros_path), f"--bridge {request.bridge}")
    return free_ros(kind.ros, folder)


def _check_plant(fleet: Fleet, bundles: Sequence[Bundle]) -> None:
    """Refuse policies that the plant cannot move; what bridge and base cannot, edge-run's own check does.

    Raises:
        EdgeError: says which, and what it would take.
    """
    if fleet.obstacles and fleet.simulation.plant == "vmas":
        raise ConfigError("obstacle: means nothing in plant 'vmas'; allowed with plant 'discs' and 'mujoco'")
    for bundle in bundles:
        if fleet.simulation.plant == "mujoco":
            check_fleet(fleet, bundle.manifest)
        motion = bundle.manifest.motion
        pushed = isinstance(motion, PointForce) and motion.action_dim == 2
        if fleet.simulation.plant == "vmas" and not pushed:
            raise BundleError(
                f"{bundle.manifest.name}: motion.type is {motion.kind!r}; plant 'vmas' takes 'point_force' "
                "in the plane, plant 'discs' any"
            )


def _team_table(request: Request, folder: Path) -> Table:
    table = _asked_table(request, folder)
    simulation = dict(table.get("simulation", {}))
    plant = request.plant or simulation.get("plant", "discs")
    check_installed(plant, f"--plant {plant}" if request.plant else f"--task {request.task}")
    return {**table, "simulation": {**simulation, "plant": plant}}


def _asked_table(request: Request, folder: Path) -> Table:
    if request.task is not None:
        write_key(folder / "team.key")
        table = task_team(request.task)
        if request.robots not in (None, len(table["robots"])):
            raise ConfigError(f"--robots {request.robots}: {request.task} has {len(table['robots'])}")
        return resolved(table, folder)
    if request.fleet is None:
        write_key(folder / "team.key")
        return resolved(generated_team(request.robots or ROBOTS, wheels=request.plant == "mujoco"), folder)
    path = request.fleet
    table = read_toml(path)
    fleet_from(table, path)
    if "carrier" not in table:
        refuse(path, "carrier", 'missing: processes need a network; add [carrier] key = "team.key"')
    if on_zenoh(table) and importlib.util.find_spec("zenoh") is None:
        refuse(path, "carrier.type", "\"zenoh\" needs an extra; run: pip install 'cfpg-edge[zenoh]'")
    robots = [robot["id"] for robot in table["robots"]]
    if request.robots not in (None, len(robots)):
        refuse(path, "robots", f"{len(robots)}, but --robots asks for {request.robots}")
    for index, robot in enumerate(table["robots"]):
        for key in ("pose", "ranges"):
            if key in robot:
                refuse(path, f"robots[{index}].{key}", "edge-sil has no streams to offer; leave it out here")
    return resolved(table, path.resolve().parent)


def _check_rights(request: Request, faults: tuple[AnyFault, ...]) -> None:
    if any(isinstance(fault, ClockJump) for fault in faults):
        _check_clock()
    if request.realtime and request.bridge in ROS:
        # Seen on two cores: threads of four guards' rospy kept both from everybody else for minutes.
        raise ConfigError(
            f"--realtime: not with --bridge {request.bridge}: its library's threads would go before all else"
        )
    if request.realtime:
        before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError as error:
            raise ConfigError(
                f"--realtime was refused ({error.strerror}): it needs CAP_SYS_NICE; run without it"
            ) from error
        os.sched_setscheduler(0, before, parameters)


def _check_clock() -> None:
    try:
        time.clock_settime(time.CLOCK_REALTIME, time.time())
    except PermissionError as error:
        raise ConfigError("the fault clock_jump may not set the clock: it needs CAP_SYS_TIME") from error


def _driven(bridge: BridgeKind, bundle: Bundle, fleet: Fleet) -> Vehicle:
    wheels = fleet.simulation.base if fleet.simulation.plant == "mujoco" else ""
    return vehicle(bridge, bundle.manifest.motion, wheels)


def _station(robot: Robot, file: Path, network: Network, bridge: BridgeKind, driven: Vehicle) -> Station:
    x, y, *_ = robot.start_m
    goal_x, goal_y, *_ = robot.goal_m or (x + 1.0, y)
    heading = math.atan2(goal_y - y, goal_x - x)
    number, port = network.wires[robot.id], network.ports[robot.id]
    wires = {"can": multicast_bus(number), "mavlink": str(number)}
    wire = wires.get(bridge, f"/robot_{robot.id}")
    goal_m = (goal_x, goal_y) if robot.goal_m else None
    return Station(robot.id, str(file), wire, port, (x, y), goal_m, heading, driven)


def robot_bundle(fleet: Fleet, robot: Robot, policy: str) -> Bundle:
    """Return what one robot runs: ``policy`` where it is not empty, with the robot's own dynamics.

    Raises:
        BundleError: if there is no such bundle, or it is damaged.
    """
    name = robot.policy or fleet.team.policy
    if policy or "/" in name:
        return adapted(load_bundle(located(policy or name)), robot, fleet.team)
    return adapted(packaged_bundle(name), robot, fleet.team)
