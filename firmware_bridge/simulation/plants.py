"""What moves a simulated team: every plant that a fleet file or --plant can name, and what each must do."""

import importlib
import importlib.util
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from edge_runtime.common.toml_file import refuse
from edge_runtime.control.mission import Mission
from edge_runtime.errors import ConfigError
from edge_runtime.messages import Command, Vector
from edge_runtime.motion.range_sensor import Disc
from edge_runtime.observation import Sensor


class Motion(NamedTuple):
    """Where something is and how it moves, in the team's frame."""

    position_m: Vector
    velocity_m_s: Vector
    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0


class TeamPlant(Protocol):
    """The world of N robots, told by their places in the fleet; SI units, the team's frame."""

    radius_m: float
    """Of the robots' discs."""
    touched: set[tuple[int, ...]]
    """(i, j), i < j, of those that have touched so far."""
    sensors: frozenset[str]
    """Names of what robots can read here, beside ranges."""

    def reset(self) -> None:
        """Put everything where the fleet file has it."""
        ...

    def drive(self, commands: Sequence[Command]) -> None:
        """Advance by one control period, each robot under its command."""
        ...

    def motions(self) -> Sequence[Motion]:
        """The robots', in order."""
        ...

    def objects(self) -> Sequence[Motion]:
        """The tracked objects', in the fleet file's order."""
        ...

    def obstacles(self) -> Sequence[Disc]:
        """What stands or walks in the robots' way beside them."""
        ...

    def reading(self, robot: int, sensor: str) -> Vector:
        """What a robot's sensor, one of `sensors`, reads now."""
        ...


class PlantModule(NamedTuple):
    """One kind of plant."""

    module: str
    """Offers ``make_plant(mission)``."""
    world: str
    """For the harness: offers ``make_world``, see `firmware_bridge.sil.firmware.planar_world`."""
    needs: str = ""
    """A package without which there is none."""
    extra: str = "train"
    """The project's own that brings it."""
    carries: bool = False
    """Whether tracked objects go anywhere in it."""


PLANTS: Final = {
    "discs": PlantModule("firmware_bridge.simulation.discs", "firmware_bridge.sil.firmware.planar_world"),
    "vmas": PlantModule(
        "export.scenarios.plant", "export.scenarios.firmware_world", needs="vmas", carries=True
    ),
    "mujoco": PlantModule(
        "firmware_bridge.simulation.wheels.plant",
        "firmware_bridge.sil.firmware.wheeled_world",
        needs="mujoco",
        extra="mujoco",
    ),
}


def check_installed(name: str, source: str) -> None:
    """Refuse a plant that this machine does not have; ``source`` named it.

    Raises:
        ConfigError: says what to install.
    """
    kind = PLANTS[name]
    if kind.needs and importlib.util.find_spec(kind.needs) is None:
        raise ConfigError(
            f"{source}: {name!r} needs a workstation's {kind.needs}; "
            f"run: pip install 'cfpg-edge[{kind.extra}]'"
        )


def open_plant(mission: Mission, named: str | None = None) -> TeamPlant:
    """Make the plant of a mission's fleet: the one that is named, or the fleet file's.

    Raises:
        ConfigError: says which plant lacks what the fleet or its policy needs, and which has it.
    """
    fleet = mission.fleet
    name = named or fleet.simulation.plant
    source = f"--plant {name}" if named else f"{fleet.path}: simulation.plant"
    kind = PLANTS[name]
    check_installed(name, source)
    for index, each in enumerate(fleet.tracked):
        if each.goal_m and not kind.carries:
            able = ", ".join(other for other in PLANTS if PLANTS[other].carries)
            what = f"nothing moves {each.name!r} in plant {name!r}; allowed: --plant {able}"
            refuse(fleet.path, f"tracked[{index}].goal_m", what)
    plant: TeamPlant = importlib.import_module(kind.module).make_plant(mission)
    for index, field in enumerate(mission.bundle.manifest.observation):
        if isinstance(field, Sensor) and field.sensor not in plant.sensors:
            raise ConfigError(
                f"{mission.bundle.directory}: observation[{index}].sensor: plant {name!r} has no "
                f"{field.sensor!r}; it has: {', '.join(sorted(plant.sensors)) or 'none'} (--plant)"
            )
    return plant
