"""Which fleets can drive on which wheels."""

from edge_runtime.common.toml_file import refuse
from edge_runtime.config.fleet import Fleet
from edge_runtime.policy.manifest import Manifest
from firmware_bridge.kinematics.fit import check_base
from firmware_bridge.simulation.wheels.bases import BASES


def check_fleet(fleet: Fleet, manifest: Manifest) -> None:
    """Refuse what does not fit the base that a fleet file names.

    Args:
        fleet: names it.
        manifest: of the policy that its robots run, in their metres.

    Raises:
        ConfigError: says what of it does not.
    """
    name, radius_m = fleet.simulation.base, manifest.body.radius_m
    base = BASES[name]
    check_base(manifest.motion, base.kinematics, f"{fleet.path}: simulation.base")
    if radius_m < base.hull_radius_m:
        least = fleet.team.scale_m * base.hull_radius_m / radius_m
        what = f"{fleet.team.scale_m:g} makes the policy's robot smaller than a {name}"
        refuse(fleet.path, "team.scale_m", f"{what}; allowed: at least {least:.3g}")
