"""The facts file to start from, with every motion model and every source that there is, a line each."""

import inspect
from collections.abc import Iterable
from typing import Final, get_args

import msgspec

from edge_runtime.motion.models import MotionModel
from edge_runtime.observation import SOURCES, Source

_EXAMPLE: Final = """\
# What edge-export must know beside the graph. SI units throughout.
# The observation's fields, in the graph's order: a source, or a table such as
#   { name = "to_goal", source = "goal_offset", frame = "body" }
# whose name, unit and size may be left out where the source says them.
observation = ["position", "velocity", "goal_offset", "proximity"]
control_rate_hz = 10.0
euler_steps = 10          # T: steps from noise (tau = 0) to the action (tau = 1)
# sampler = "exponential" # of second order: fewer steps are as near to the flow
# sampler_steps = 5       # those steps, in place of T

[[action]]                # the action's components, in the graph's order; low <= 0 <= high
name = "force_x"
unit = "N"
low = -1.0
high = 1.0

[[action]]
name = "force_y"
unit = "N"
low = -1.0
high = 1.0

[motion]                  # how the robot moves under its action
type = "point_force"
mass_kg = 1.0
drag = 0.25
dt_s = 0.1                # 1 / control_rate_hz
substeps = 2

[body]
radius_m = 0.1
lidar_rays = 12           # 0 without a range sensor; then lidar_range_m = 0
lidar_range_m = 0.35
"""


def facts_template() -> str:
    """Return the text of the file."""
    models = _lines(get_args(MotionModel), ())
    sources = _lines(SOURCES, Source.__struct_fields__)
    return "\n".join([_EXAMPLE, "# Motion models, by their type:", *models, "", "# Sources:", *sources])


def _lines(kinds: Iterable[type[msgspec.Struct]], common: tuple[str, ...]) -> Iterable[str]:
    """A comment for each kind: what it is, and the keys that are its own, with their defaults."""
    for kind in kinds:
        keys = [_key(field) for field in msgspec.structs.fields(kind) if field.name not in common]
        about = " ".join(inspect.getdoc(kind).split("\n\n")[0].split())
        own = f" [{', '.join(keys)}]" if keys else ""
        yield f"#   {kind.__struct_config__.tag:20} {about}{own}"


def _key(field: msgspec.structs.FieldInfo) -> str:
    if field.required:
        return f"{field.name} = ..."
    if field.default in (None, msgspec.NODEFAULT):
        return field.name
    return f"{field.name} = {msgspec.json.encode(field.default).decode()}"
