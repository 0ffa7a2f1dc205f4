"""Where one robot differs from the one that its policy was trained for."""

from dataclasses import replace as with_fields

import msgspec
from msgspec.structs import replace

from edge_runtime.errors import ConfigError
from edge_runtime.observation.border import Arena
from edge_runtime.policy.bundle import Bundle


class Adaptation(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a fleet file says of it; None for what is as in training."""

    mass_kg: float | None = None
    drag: float | None = None
    """Share of the velocity lost in one step of the policy."""
    max_action: float | None = None
    """Greatest magnitude of each action component, in its unit."""
    scale_m: float = 1.0
    """One of the policy's metres, in metres of the robot's world."""
    training_arena: Arena | None = None
    """On whose border the policy observes places beyond, in the robot's metres."""


def adapt(bundle: Bundle, adaptation: Adaptation) -> Bundle:
    """Return the bundle as the robot runs it: its body, dynamics and limits, in the robot's own metres.

    The action stays the policy's, in its units: an action that moves the policy's robot by a metre moves
    this one by ``scale_m``. Observations are brought to the policy's metres where they are composed, see
    `edge_runtime.observation.observer`; everything else, objectives included, is in the robot's.

    Raises:
        ConfigError: if the policy's motion model has no such number.
    """
    manifest, scale = bundle.manifest, adaptation.scale_m
    own = {name: getattr(adaptation, name) for name in ("mass_kg", "drag")}
    own = {name: value for name, value in own.items() if value is not None}
    for name in own:
        if not hasattr(manifest.motion, name):
            raise ConfigError(
                f"{bundle.directory}: motion {manifest.motion.kind!r} has no {name}: a robot of this policy "
                "cannot have its own"
            )
    motion = replace(manifest.motion, **own)
    body, most, action = manifest.body, adaptation.max_action, manifest.action
    if most is not None:
        action = tuple(
            replace(field, low=max(field.low, -most), high=min(field.high, most)) for field in action
        )
    body = replace(body, radius_m=body.radius_m * scale, lidar_range_m=body.lidar_range_m * scale)
    adapted = replace(manifest, motion=motion.scaled(scale), body=body, action=action)
    return with_fields(bundle, manifest=adapted)
