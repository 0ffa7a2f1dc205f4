"""Which bases can follow which policies."""

from edge_runtime.errors import ConfigError
from edge_runtime.motion.models import MotionModel, Unicycle
from firmware_bridge.kinematics.base import Base


def check_fit(motion: MotionModel, name: str, *, sideways: bool, space: bool = False) -> None:
    """Refuse a policy whose action a base cannot follow.

    Args:
        motion: the policy's.
        name: what to call the base.
        sideways: whether it moves sideways, and turns meanwhile, at will.
        space: whether it moves in space.

    Raises:
        ConfigError: says which models the base can follow.
    """
    if motion.dims == 3 and not space:
        raise ConfigError(f"the policy moves in space ({motion.kind}): {name} moves in the plane alone")
    if motion.turns and not sideways and not isinstance(motion, Unicycle):
        raise ConfigError(
            f"the policy turns and moves sideways ({motion.kind} with an angular component), which {name} "
            "cannot: it takes unicycle policies, and those that do not turn"
        )


def check_base(motion: MotionModel, base: Base, profile: str) -> None:
    """Refuse a policy whose action a profile's base cannot follow; raises as `check_fit`."""
    check_fit(motion, f"the {base.kind} base of {profile}", sideways=base.kind == "omnidirectional")
    if base.sideways == "turn" and not motion.turns:
        raise ConfigError(f"{profile}: base.sideways is 'turn', but the policy ({motion.kind}) does not turn")
