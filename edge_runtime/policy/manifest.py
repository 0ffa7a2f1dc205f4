"""What a bundle says about its policy: the records of ``manifest.json``, SI units throughout."""

import math
from typing import Literal

import msgspec
import numpy as np

from edge_runtime.motion.dynamics import Dynamics
from edge_runtime.motion.range_sensor import RangeSensor
from edge_runtime.policy.weights import Activation

BUNDLE_FORMAT = "cfpg-bundle/1"

FlowStart = Literal["noise", "zero"]
"""What a flow was trained to start from: standard normal noise, or zero alone (a Gaussian policy's mean)."""


class ObservationField(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One contiguous piece of the observation vector."""

    name: str
    """Which of the known fields."""
    size: int
    """Components."""
    unit: str
    """Of each component."""
    seen: tuple[tuple[float, float], ...] | None = None
    """Least and greatest value of each component in training; None where that is not known."""


class ActionField(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One component of the action, with the limits that the policy was trained under."""

    name: str
    """Which of the known components."""
    unit: str
    """Of the component."""
    low: float
    """Least value; at most 0, which is rest."""
    high: float
    """Greatest value; at least 0."""


class Body(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The robot that the policy was trained for: its disc and its range sensor."""

    radius_m: float
    """Of its disc."""
    lidar_rays: int
    """How many, evenly spread; 0 for none."""
    lidar_range_m: float
    """Of each ray; 0 without rays."""
    lidar_start_rad: float = 0.0
    """Direction of the first ray, from x counter-clockwise; the others follow evenly."""

    def sensor(self) -> RangeSensor:
        """Prepare its range sensor, which may have no rays."""
        angle = self.lidar_start_rad + np.arange(self.lidar_rays) * (2.0 * math.pi / max(self.lidar_rays, 1))
        rays = tuple(zip(np.cos(angle).tolist(), np.sin(angle).tolist(), strict=True))
        return RangeSensor(rays, self.lidar_range_m, self.radius_m)


class Network(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Shape of the flow network in ``policy.npz``."""

    activation: Activation
    """Between its layers."""
    hidden: tuple[int, ...]
    """Units of each hidden layer."""
    prior_std: float | None
    """s of the prior field, which the network corrects; None where the network is all there is."""


class Training(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the policy comes from."""

    scenario: str
    """The task."""
    algorithm: str
    """As ``edge-train --algorithm`` calls it."""
    seed: int
    """Of the training."""
    frames: int
    """Steps of experience."""
    commit: str
    """Of the training's code."""
    score: float
    """Unguided success on validation episodes, in [0, 1]."""


class Spaces:
    """Whatever says what a policy observes and does, by the sizes of both."""

    __slots__ = ()
    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]

    @property
    def observation_dim(self) -> int:
        """Size O of the observation vector."""
        return sum(field.size for field in self.observation)

    @property
    def action_dim(self) -> int:
        """Size d of the action vector."""
        return len(self.action)


class Manifest(Spaces, msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """``manifest.json``: everything the robot must know to run the policy as it was trained."""

    format: str
    """``BUNDLE_FORMAT``."""
    name: str
    """What summaries and logs call it."""
    runtime: Literal["numpy", "onnxruntime"]
    """Who can compute it: ``numpy`` from policy.npz, or ``onnxruntime`` from policy.onnx alone."""
    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]
    control_rate_hz: float
    """The rate that it was trained at."""
    euler_steps: int
    """T, the steps in which an action is made."""
    network: Network | None
    """None where only onnxruntime can express the graph."""
    dynamics: Dynamics
    body: Body
    training: Training | None
    """None for a policy whose training is not known."""
    files: dict[str, str]
    """SHA-256 of each other file of the bundle, in hexadecimal."""
    start: FlowStart = "noise"
    """What its flow starts from."""
