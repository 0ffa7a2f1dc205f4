"""What a fleet file may say about Zenoh."""

import re
from collections.abc import Sequence
from pathlib import Path

from edge_runtime.common.toml_file import refuse
from edge_runtime.config.network import CarrierSettings, Robot, endpoint


def check_zenoh(path: Path, carrier: CarrierSettings | None, robots: Sequence[Robot]) -> None:
    """Check what the fleet file says of Zenoh.

    Raises:
        ConfigError: names the file, the key and what does not hold together.
    """
    if carrier is None or carrier.type != "zenoh":
        _refuse_unused(path, carrier, robots)
    elif carrier.router is not None:
        _check_router(path, carrier.router, secure=carrier.tls is not None)
        for index, robot in enumerate(robots):
            if robot.zenoh is not None:
                refuse(path, f"robots[{index}].zenoh", "means nothing with carrier.router; take one away")
    else:
        _check_places(path, robots)


def _refuse_unused(path: Path, carrier: CarrierSettings | None, robots: Sequence[Robot]) -> None:
    unused = [f"carrier.{key}" for key in ("router", "tls") if carrier and getattr(carrier, key) is not None]
    unused += [f"robots[{index}].zenoh" for index, robot in enumerate(robots) if robot.zenoh is not None]
    if unused:
        refuse(path, unused[0], 'means nothing unless [carrier] has type = "zenoh"')


def _check_router(path: Path, router: str, *, secure: bool) -> None:
    found = re.fullmatch(r"(tcp|tls)/([\w.-]+|\[[0-9a-fA-F:.]+\]):(\d{1,5})", router, re.ASCII)
    if found is None or not 0 < int(found[3]) < 2**16:
        refuse(path, "carrier.router", f"must be such as tls/router.local:7447, got {router!r}")
    if secure != (found[1] == "tls"):
        remedy = 'add [carrier.tls], or use "tcp/..."' if found[1] == "tls" else 'use "tls/..."'
        refuse(path, "carrier.router", f"{router} and [carrier.tls] belong together; {remedy}")


def _check_places(path: Path, robots: Sequence[Robot]) -> None:
    taken = [endpoint(robot.address) for robot in robots if robot.address is not None]
    for index, robot in enumerate(robots):
        key = f"robots[{index}].zenoh"
        if robot.zenoh is None:
            refuse(path, key, "missing; without carrier.router every robot needs one, such as 10.0.0.12:7447")
        place = endpoint(robot.zenoh)
        if place in taken:
            refuse(path, key, f"{robot.zenoh} is taken by another robot or address")
        taken.append(place)
