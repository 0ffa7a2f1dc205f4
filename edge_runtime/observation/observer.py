"""The policy's input, composed in the order of the manifest's fields, each from its source."""

import math
from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np

from edge_runtime.common.arrays import Array
from edge_runtime.common.own_code import cause_of
from edge_runtime.common.signals import is_interrupt
from edge_runtime.messages import TeamState, Vector
from edge_runtime.motion.body import Body
from edge_runtime.observation import ObservationField, OwnSource, Source, SourceError, View

LENGTHS = ("m", "m/s", "m/s^2")
"""Units that grow with the policy's metre."""


class Observed(Protocol):
    """What a manifest says of a policy's input."""

    @property
    def observation(self) -> tuple[ObservationField, ...]:
        """The fields, in order."""
        ...

    @property
    def body(self) -> Body:
        """The robot with its range sensor."""
        ...


class Observer:
    """Composes one robot's observations; the returned array is reused by the next call.

    Args:
        manifest: names the fields and the robot's body; already checked.
        goal_m: where the robot is to go.
        scale_m: one of the policy's metres, in the robot's.
        own: the sources of the user's own that may run here.
        path: the manifest's, for errors.

    Raises:
        ConfigError: if the policy observes by code that may not run here, or cannot be made.
    """

    def __init__(
        self,
        manifest: Observed,
        goal_m: Vector,
        scale_m: float = 1.0,
        *,
        own: Collection[type[Source]] = (),
        path: str = "manifest.json",
    ) -> None:
        self.goal_m = goal_m
        self.fault = ""
        """Why the newest observation is of no use; empty if it is."""
        self._sensor = manifest.body.sensor()
        self._sources: list[tuple[Source, bool]] = []
        for index, field in enumerate(manifest.observation):
            if isinstance(field, OwnSource):
                self._sources.append((field.made(own, path, f"observation[{index}]"), True))
            else:
                self._sources.append((field, False))
        size = sum(field.size for field in manifest.observation)
        self._vector = np.zeros((1, size), np.float32)
        self._per_unit = _per_unit(manifest, scale_m) if scale_m != 1.0 else None

    def observe(
        self, team: TeamState, previous_action: Vector = (), elapsed_s: float = 0.0, ease_m: float = 0.0
    ) -> Array:
        """Compose the observation (1, O) of what the robot knows of itself and its team.

        A field whose source has nothing to give, or fails, is NaN, and `fault` names it.

        Args:
            team: this tick's view.
            previous_action: what the robot was commanded last.
            elapsed_s: since its first tick.
            ease_m: how much farther away than they are its ranges see teammates.

        Raises:
            PolicyError: if the number of readings is not the number of rays.
        """
        view = View(team, self.goal_m, self._sensor, previous_action, elapsed_s, ease_m)
        values: list[float] = []
        self.fault = ""
        for source, is_own in self._sources:
            try:
                values += _checked(source, view) if is_own else source.read(view)
            except SourceError as error:
                values += [math.nan] * source.size
                self.fault = self.fault or f"observation {source.name}: {error}"
        self._vector[0] = values
        if self._per_unit is not None:
            self._vector *= self._per_unit
        return self._vector


def _checked(source: Source, view: View) -> Sequence[float]:
    """What a source of the user's own returns.

    Raises:
        SourceError: if it raises, or returns anything but as many finite numbers as the field has components.
    """
    try:
        values = [float(value) for value in source.read(view)]
    except SourceError:
        raise
    except BaseException as error:  # it may raise anything
        if is_interrupt(error):
            raise
        raise SourceError(f"its source raised {cause_of(error)}") from error
    if len(values) != source.size:
        raise SourceError(f"its source returned {len(values)} numbers, not {source.size}")
    if not math.isfinite(sum(values)):
        raise SourceError("its source returned what is not finite")
    return values


def _per_unit(manifest: Observed, scale_m: float) -> Array:
    """The policy's units in one of the robot's, (O,): lengths and speeds scale, angles and numbers do not."""
    shares = [
        1.0 / scale_m if field.unit in LENGTHS and not field.of_policy else 1.0
        for field in manifest.observation
        for _ in range(field.size)
    ]
    return np.array(shares, np.float32)
