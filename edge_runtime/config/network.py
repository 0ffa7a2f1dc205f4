"""What a fleet file says about its robots and their network, and whether it holds together."""

import ipaddress
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec

from edge_runtime.common.bounds import GREATEST, check_bounds
from edge_runtime.common.toml_file import refuse
from edge_runtime.messages import Place

Endpoint = tuple[str, int]
"""IP address and port."""


class Robot(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One member of the team."""

    id: int
    """What frames, flags and reports call it; each robot's is its own."""
    start_m: Place
    """Where a simulated robot starts."""
    goal_m: Place | None = None
    """Where it is to go, in the team's frame; None for one that serves a common task instead."""
    start_heading_rad: float = 0.0
    """Which way a simulated robot faces at first, counter-clockwise from x."""
    address: str | None = None
    """Where it listens in the team's network, such as ``10.0.0.12:47000``; see ``[carrier]``."""
    neighbours: tuple[int, ...] | None = None
    """Ids of the robots that it listens to; all others where None."""
    policy: str | None = None
    """Its policy, where that is not the team's; see `edge_runtime.config.fleet.Team.policy`."""
    mass_kg: float | None = None
    """Of its dynamics; the policy's where None."""
    drag: float | None = None
    """Share of the velocity lost in one step of the policy; the policy's where None."""
    slew_per_s: float | None = None
    """Greatest change of each action component in a second; the team's where None."""
    max_action: float | None = None
    """Greatest magnitude of each action component; the team's where None."""
    max_speed_m_s: float | None = None
    """Greatest commanded speed; the bridge's where None."""
    pose: str = "bridge"
    """Who tells its pose: its bridge, or the address of a stream, such as edge-pose's ``10.0.0.5:47100``."""
    ranges: str = "teammates"
    """Where its ranges come from: computed from the teammates' poses, or the address of a stream."""
    sensors: dict[str, str] = {}
    """Where readings of further sensors come from: the address of a stream, by the sensor's name."""
    rigid_body: int | None = None
    """Its streaming id in the motion-capture system; the robot's where None."""
    zenoh: str | None = None
    """Where it listens to its team on Zenoh, such as ``10.0.0.12:7447``; see `CarrierSettings.type`."""

    def __post_init__(self) -> None:
        if not 0 <= self.id < 2**16:
            raise ValueError(f"`id` must lie in [0, 65535], got {self.id}")
        for address in (self.address, self.zenoh):
            if address is not None:
                endpoint(address)
        for field in ("pose_place", "ranges_place", "sensor_places"):
            getattr(self, field)
        check_bounds(self, dict.fromkeys(("start_m", "goal_m"), (-GREATEST, GREATEST)))
        check_bounds(self, {"start_heading_rad": (-2.0 * math.pi, 2.0 * math.pi)})
        positive = (1.0 / GREATEST, GREATEST)
        check_bounds(self, dict.fromkeys(("mass_kg", "slew_per_s", "max_action", "max_speed_m_s"), positive))
        if self.drag is not None and not 0.0 <= self.drag < 1.0:
            raise ValueError(f"`drag` must lie in [0, 1), got {self.drag:g}")
        if self.neighbours and len(set(self.neighbours)) < len(self.neighbours):
            raise ValueError(f"`neighbours` names a robot twice: {list(self.neighbours)}")

    @property
    def pose_place(self) -> Endpoint | None:
        """Where its pose stream comes from; None if the bridge tells the pose."""
        return None if self.pose == "bridge" else stream_place(self.pose, "pose", "bridge")

    @property
    def ranges_place(self) -> Endpoint | None:
        """Where its range stream comes from; None if ranges are computed."""
        return None if self.ranges == "teammates" else stream_place(self.ranges, "ranges", "teammates")

    @property
    def sensor_places(self) -> dict[str, Endpoint]:
        """Where the readings of each further sensor come from."""
        return {name: stream_place(address, "sensors") for name, address in self.sensors.items()}


class TlsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Files of certificates, relative to the fleet file; ``{id}`` stands for the robot's id."""

    ca: str
    """Of the authority that issued the certificates of all robots and of the router."""
    certificate: str
    """The robot's, with the common name ``robot-<id>``."""
    private_key: str
    """The certificate's."""


class CarrierSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How robots that run as processes of their own hear each other: the table ``[carrier]``."""

    key: str
    """File of the team's key, relative to the fleet file."""
    type: Literal["udp", "zenoh"] = "udp"
    """What carries frames; orders, streams and status always travel over UDP."""
    operator_key: str | None = None
    """File of the key of those who may order by edge-ctl; the team's key where None."""
    nearest: int | None = None
    """A robot listens to this many nearest ones of its neighbours; to all of them where None."""
    alone_s: float = 1.0
    """How long a robot drives on while it hears nobody."""
    missing_s: float = 30.0
    """How long a robot drives on without any one of those that it listens to."""
    router: str | None = None
    """The Zenoh router between all robots, such as ``tls/10.0.0.1:7447``; none where None."""
    tls: TlsSettings | None = None
    """The Zenoh team's certificates; neither encrypted nor access controlled where None."""

    def __post_init__(self) -> None:
        for name in ("key", "operator_key"):
            if getattr(self, name) == "":
                raise ValueError(f'`{name}` must name the file of a key, such as "team.key"; it is empty')
        if self.nearest is not None and self.nearest < 1:
            raise ValueError(f"`nearest` must be at least 1, got {self.nearest}")
        check_bounds(self, {"alone_s": (1e-3, 86400.0), "missing_s": (1e-3, 86400.0)})


class WatchSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Who watches the team: the table ``[watch]``."""

    address: str
    """Where edge-watch listens, such as ``10.0.0.5:47900``; every robot sends its status there."""

    def __post_init__(self) -> None:
        endpoint(self.address)


def stream_place(address: str, field: str, word: str = "") -> Endpoint:
    """Read the address of a stream, instead of which a field may say a word.

    Raises:
        ValueError: if it is none.
    """
    try:
        return endpoint(address)
    except ValueError:
        choice = f'"{word}" or ' if word else ""
        raise ValueError(
            f"`{field}` must be {choice}a stream's address, such as 10.0.0.5:47100, got {address!r}"
        ) from None


def endpoint(address: str) -> Endpoint:
    """Read an address such as ``10.0.0.12:47000`` or ``[fd00::12]:47000``.

    Raises:
        ValueError: if it is no address of one machine with a port.
    """
    host, _, port = address.rpartition(":")
    try:
        ip = ipaddress.ip_address(host[1:-1] if host.startswith("[") and host.endswith("]") else host)
    except ValueError:
        ip = None
    bracketed = host.startswith("[")
    if (
        ip is None
        or ip.is_unspecified
        or ip.is_multicast
        or bracketed != (ip.version == 6)
        or not (port.isascii() and port.isdigit() and 0 < int(port) < 2**16)
    ):
        raise ValueError(
            f"`address` must be one machine's IP and port, such as 10.0.0.12:47000, got {address!r}"
        )
    return str(ip), int(port)


def check_network(
    path: Path, carrier: CarrierSettings | None, watch: WatchSettings | None, robots: Sequence["Robot"]
) -> None:
    """Check what no robot's entry shows by itself.

    Raises:
        ConfigError: names the file, the key and what does not hold together.
    """
    ids = [robot.id for robot in robots]
    for index, robot in enumerate(robots):
        for robot_id in robot.neighbours or ():
            if robot_id not in ids or robot_id == robot.id:
                others = ", ".join(str(other) for other in ids if other != robot.id)
                refuse(
                    path, f"robots[{index}].neighbours", f"no other robot has id {robot_id}; others: {others}"
                )
        if carrier is None:
            _refuse_without_carrier(path, index, robot)
    if carrier is not None:
        _check_addresses(path, robots)
    if watch is not None:
        _check_watch(path, carrier, watch, robots)


def _refuse_without_carrier(path: Path, index: int, robot: "Robot") -> None:
    simulated = Robot(robot.id, robot.start_m, robot.goal_m)
    for key in (
        "address",
        "zenoh",
        "neighbours",
        "policy",
        "mass_kg",
        "drag",
        "pose",
        "ranges",
        "sensors",
        "rigid_body",
    ):
        if getattr(robot, key) != getattr(simulated, key):
            refuse(
                path,
                f"robots[{index}].{key}",
                'means nothing without [carrier]; add [carrier] key = "team.key"',
            )


def _check_addresses(path: Path, robots: Sequence["Robot"]) -> None:
    taken: list[Endpoint] = []
    for index, robot in enumerate(robots):
        key = f"robots[{index}].address"
        if robot.address is None:
            refuse(path, key, "missing; with [carrier] every robot needs one, such as 10.0.0.12:47000")
        place = endpoint(robot.address)
        if place in taken:
            refuse(path, key, f"{robot.address} is taken by robots[{taken.index(place)}]")
        if taken and (":" in place[0]) != (":" in taken[0][0]):
            refuse(path, key, "IPv4 and IPv6 do not mix in one team")
        taken.append(place)


def _check_watch(
    path: Path, carrier: CarrierSettings | None, watch: WatchSettings, robots: Sequence["Robot"]
) -> None:
    if carrier is None:
        refuse(path, "watch", 'means nothing without [carrier]; add [carrier] key = "team.key"')
    taken = [endpoint(robot.address) for robot in robots if robot.address is not None]
    place = endpoint(watch.address)
    if place in taken:
        refuse(path, "watch.address", f"{watch.address} is taken by robots[{taken.index(place)}]")
