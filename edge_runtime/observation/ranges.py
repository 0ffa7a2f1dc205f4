"""Sources that tell what the robot's sensors read."""

from collections.abc import Sequence
from typing import ClassVar

from edge_runtime.messages import Vector
from edge_runtime.observation.source import Extent, Name, Source, SourceError, View


class Ranges(Source, frozen=True, tag="ranges"):
    """Readings of the range sensor, ray by ray; computed from the teammates' discs without a real one."""

    unit_here: ClassVar[str] = "m"

    def components(self, extent: Extent) -> int:
        """One a ray."""
        return extent.rays

    def read(self, view: View) -> Sequence[float]:
        """See `edge_runtime.motion.range_sensor`."""
        return view.ranges()


class Proximity(Ranges, frozen=True, tag="proximity"):
    """The sensor's range minus each reading: zero where nothing is near."""

    def read(self, view: View) -> Sequence[float]:
        """As `Ranges`."""
        reach = view.sensor.range_m
        return [reach - reading for reading in view.ranges()]


class Sensor(Source, frozen=True, kw_only=True, tag="sensor"):
    """What a sensor of this name read, which the link to the robot or its simulation provides."""

    sensor: Name
    """Its name in the fleet file."""

    def read(self, view: View) -> Sequence[float]:
        """Of this tick."""
        for reading in view.team.readings:
            if reading.sensor == self.sensor:
                return self._whole(reading.values)
        raise SourceError(f"sensor {self.sensor!r} has no reading")

    def _whole(self, values: Vector) -> Vector:
        if len(values) == self.size:
            return values
        raise SourceError(f"sensor {self.sensor!r} has {len(values)} numbers, not {self.size}")
