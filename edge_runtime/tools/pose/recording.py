"""Recorded poses and ranges: JSON lines or CSV, in the order of their times.

One line is one robot's pose, ``{"t": 0.01, "robot": 0, "x": 0.2, "y": -0.1, "heading": 0.0}`` with ``vx`` and
``vy`` if they are known, in space with ``z`` and ``vz`` too, or what its sensor read, ``{"t": 0.01,
"robot": 0, "ranges": [0.35, 0.2]}``. A tracked object's pose has its name instead of a robot,
``"object": "package"``. CSV has the poses' names in its first line. SI units, the team's frame.
"""

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.bounds import GREATEST, GREATEST_SPEED_M_S, check_bounds
from edge_runtime.common.regular_file import BYTE_ORDER_MARK, read_regular
from edge_runtime.errors import ConfigError
from edge_runtime.network.stream_wire import MOST_VALUES

LARGEST_FILE: Final = 1 << 26
"""Bytes; four robots at 100 Hz for half an hour take it."""


class Sample(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One line."""

    t: float
    """Seconds from the start of the recording."""
    robot: int | None = None
    object: str | None = None
    """Name of the tracked object that the line is about, instead of a robot."""
    x: float | None = None
    y: float | None = None
    z: float | None = None
    """Of what moves in space."""
    heading: float = 0.0
    vx: float | None = None
    vy: float | None = None
    vz: float | None = None
    ranges: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if (self.robot is None) == (self.object is None):
            raise ValueError("a line has either `robot` or `object`")
        if self.object is not None and self.ranges is not None:
            raise ValueError("`ranges` are a robot's, no object's")
        if (self.x is None or self.y is None) == (self.ranges is None):
            raise ValueError("a line has either `x` and `y`, or `ranges`")
        if (self.vx is None) != (self.vy is None):
            raise ValueError("`vx` and `vy` go together")
        if self.z is not None and self.x is None:
            raise ValueError("`z` needs `x` and `y`")
        if (self.vz is None) != (self.vx is None or self.z is None):
            raise ValueError("`vz` goes with `vx`, `vy` and `z`")
        if len(self.ranges or ()) > MOST_VALUES:
            raise ValueError(f"`ranges` has {len(self.ranges or ())} numbers, at most {MOST_VALUES}")
        motion = (self.x, self.y, self.z, self.vx, self.vy, self.vz)
        numbers = (self.t, self.heading, *motion, *(self.ranges or ()))
        if not all(math.isfinite(number) for number in numbers if number is not None):
            raise ValueError("every number must be finite")
        place, speed = (-GREATEST, GREATEST), (-GREATEST_SPEED_M_S, GREATEST_SPEED_M_S)
        check_bounds(self, dict.fromkeys(("x", "y", "z", "heading", "ranges"), place))
        check_bounds(self, dict.fromkeys(("vx", "vy", "vz"), speed))


def read_recording(path: Path) -> list[Sample]:
    """Read a recording.

    Raises:
        ConfigError: names the file, the line and what is wrong there.
    """
    try:
        content = read_regular(path, LARGEST_FILE).removeprefix(BYTE_ORDER_MARK)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    samples: list[Sample] = []
    number = 1
    try:
        for number, row in _rows(content, csv_file=path.suffix == ".csv"):  # noqa: B007  # the error tells it
            sample = _sample(row)
            if samples and sample.t < samples[-1].t:
                raise ValueError(f"t goes back to {sample.t:g}")
            samples.append(sample)
    except (ValueError, msgspec.MsgspecError, csv.Error) as error:
        raise ConfigError(f"{path}: line {number}: {error}") from error
    if not samples:
        raise ConfigError(
            f"{path}: is empty; a line is one robot's pose, or its ranges, or one object's pose"
        )
    return samples


def _rows(content: bytes, *, csv_file: bool) -> Iterator[tuple[int, bytes | dict[str, str]]]:
    if csv_file:
        yield from enumerate(csv.DictReader(content.decode().splitlines()), 2)
    else:
        yield from ((number, line) for number, line in enumerate(io.BytesIO(content), 1) if line.strip())


def _sample(row: bytes | dict[str, str]) -> Sample:
    if isinstance(row, bytes):
        return msgspec.json.decode(row, type=Sample)
    return msgspec.convert({name: text for name, text in row.items() if text != ""}, Sample, strict=False)
