"""What a velocity field alone does not say: fields, limits, rate, dynamics and body of its robots."""

from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.common.toml_file import read_toml, to_record
from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.policy.manifest import (
    BUNDLE_FORMAT,
    ActionField,
    Body,
    FlowStart,
    Manifest,
    Network,
    ObservationField,
    Spaces,
    Training,
)
from edge_runtime.policy.schema import (
    ACTION_UNITS,
    GRAPH_FILE,
    OBSERVATION_UNITS,
    check_manifest,
    observation_size,
)

FACTS_TEMPLATE: Final = """\
# What edge-export must know beside the graph. SI units throughout.
observation = ["position", "velocity", "goal_offset", "proximity"]  # in the graph's order; goal_offset is
                          # position - goal (m), proximity is lidar_range_m - measured range (m) for each ray
control_rate_hz = 10.0
euler_steps = 10          # T: steps from noise (tau = 0) to the action (tau = 1)

[action]                  # force along x and y, N
low = -1.0
high = 1.0

[dynamics]                # v <- (1 - drag) v + force / mass_kg dt_s
mass_kg = 1.0
drag = 0.25
dt_s = 0.1
substeps = 2

[body]
radius_m = 0.1
lidar_rays = 12           # 0 without a range sensor; then lidar_range_m = 0
lidar_range_m = 0.35
"""


class Facts(Spaces, msgspec.Struct, frozen=True):
    """The part of a manifest that is known before any file is written."""

    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]
    control_rate_hz: float
    euler_steps: int
    dynamics: Dynamics
    body: Body
    training: Training | None = None
    start: FlowStart = "noise"

    def manifest(self, name: str, network: Network | None, files: dict[str, str]) -> Manifest:
        """Complete the manifest of a bundle; without ``network`` it is one for onnxruntime."""
        return Manifest(
            format=BUNDLE_FORMAT,
            name=name,
            runtime="onnxruntime" if network is None else "numpy",
            observation=self.observation,
            action=self.action,
            control_rate_hz=self.control_rate_hz,
            euler_steps=self.euler_steps,
            network=network,
            dynamics=self.dynamics,
            body=self.body,
            training=self.training,
            files=files,
            start=self.start,
        )


class _Limits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    low: float
    high: float


class _FactsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    observation: tuple[str, ...]
    control_rate_hz: float
    euler_steps: int
    action: _Limits
    dynamics: Dynamics
    body: Body


def read_facts(path: Path) -> Facts:
    """Read the TOML file of which `FACTS_TEMPLATE` is an example.

    Raises:
        ConfigError: if the file cannot be read or a key is missing, unknown or of the wrong type.
        BundleError: if a value fits no robot; names the key and what fits.
    """
    file = to_record(read_toml(path), _FactsFile, path)
    facts = Facts(
        observation=tuple(
            ObservationField(name, observation_size(name, file.body), OBSERVATION_UNITS.get(name, ""))
            for name in file.observation
        ),
        action=tuple(
            ActionField(name, unit, file.action.low, file.action.high) for name, unit in ACTION_UNITS.items()
        ),
        control_rate_hz=file.control_rate_hz,
        euler_steps=file.euler_steps,
        dynamics=file.dynamics,
        body=file.body,
    )
    check_manifest(facts.manifest("facts", None, {GRAPH_FILE: "0" * 64}), str(path))
    return facts
