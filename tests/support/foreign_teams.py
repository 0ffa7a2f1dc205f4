"""Teams of somebody else's policies: four robots that exchange places, and what they are asked to keep."""

import math

from foreign_policies import POLICIES, exported, fitted

from edge_runtime.policy.bundle import load_bundle
from export.edge_export import main as edge_export

CORNERS = ((-0.8, -0.5), (0.8, 0.5), (-0.8, 0.5), (0.8, -0.5))
HEIGHTS = (0.5, 0.6, 0.7, 0.55)
CEILING_M = 0.9
_CEILING = """
from edge_runtime.objectives import Objective, Slope


class Ceiling(Objective, frozen=True, kw_only=True):
    height_m: float

    def evaluate(self, motion, outlook):
        gain = outlook.preview.position_gain
        cure = max(0.0, motion.z - self.height_m) / gain
        return Slope(0.5 * cure * cure, d_z=cure / gain)
"""


def imported(name, folder):
    """Fit and export a policy, and import it by the command that users have."""
    policy = POLICIES[name]
    field = fitted(policy)
    inputs = field.layers[0].in_features - 1 - field.layers[-1].out_features
    graph = exported(field, inputs, folder / "velocity.onnx")
    (folder / "facts.toml").write_text(policy.facts)
    flags = ["--from-onnx", graph, "--facts", folder / "facts.toml", "--out", folder / name]
    assert edge_export([*map(str, flags)]) == 0
    return load_bundle(folder / name)


def starts_m(dims):
    """Where the robots begin; each is to go to the opposite corner, at its height."""
    return [[x, y, z][:dims] for (x, y), z in zip(CORNERS, HEIGHTS, strict=True)]


def robots(dims, further=lambda _: ""):
    """Their tables in a fleet file; each faces where it has to go."""
    text = ""
    for robot_id, (x, y, *height) in enumerate(starts_m(dims)):
        text += f"[[robots]]\nid = {robot_id}\nstart_m = {[x, y, *height]}\ngoal_m = {[-x, -y, *height]}\n"
        text += f"start_heading_rad = {math.atan2(-y, -x)}\n{further(robot_id)}\n"
    return text


def distance_m(name):
    """What a team is asked to keep, and its policy alone does not."""
    return 0.34 if name == "roller" else 0.38


def asked(name, folder):
    """What is asked of a team, as a file's text: that distance; of drones a ceiling, too."""
    text = f"[[objectives]]\ntype = 'safety_margin'\ndistance_m = {distance_m(name)}\n"
    text += "buffer_m = 0.04\nlook_ahead = 2\n"
    if name == "drone":
        (folder / "ceiling.py").write_text(_CEILING)
        text += f"[[objectives]]\ntype = 'ceiling:Ceiling'\nheight_m = {CEILING_M}\n"
    return text
