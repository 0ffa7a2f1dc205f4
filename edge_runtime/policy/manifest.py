"""What a bundle says about its policy: the records of ``manifest.json``, SI units throughout."""

from typing import Literal

import msgspec

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import MotionModel
from edge_runtime.observation import Extent, ObservationField
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.weights import Activation

BUNDLE_FORMAT = "cfpg-bundle/2"

FlowStart = Literal["noise", "zero"]
"""What a flow was trained to start from: standard normal noise, or zero alone (a Gaussian policy's mean)."""


class ActionField(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One component of the action, with the limits that the policy was trained under."""

    name: str
    """Which component, such as force_x."""
    unit: str
    """Of the component."""
    low: float
    """Least value; at most 0, which is rest."""
    high: float
    """Greatest value; at least 0."""


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
    """Whatever says what a policy observes and does, on what robot."""

    __slots__ = ()
    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]
    motion: MotionModel
    body: Body

    @property
    def extent(self) -> Extent:
        """What the sizes of observation fields depend on."""
        return Extent(self.motion.dims, self.action_dim, self.body.lidar_rays)

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
    """What this file is, such as ``cfpg-bundle/2``."""
    name: str
    """What summaries and logs call it."""
    runtime: Literal["numpy", "onnxruntime"]
    """Who can compute it: ``numpy`` from policy.npz, or ``onnxruntime`` from policy.onnx alone."""
    observation: tuple[ObservationField, ...]
    """The fields in their order, each with its ``source``."""
    action: tuple[ActionField, ...]
    control_rate_hz: float
    """The rate that it was trained at."""
    euler_steps: int
    """T, the steps in which an action was made in training, and is unless `sampler_steps` says otherwise."""
    network: Network | None
    """None where only onnxruntime can express the graph."""
    motion: MotionModel
    """What an action does: a motion model, with its ``type``."""
    body: Body
    training: Training | None
    """None for a policy whose training is not known."""
    files: dict[str, str]
    """SHA-256 of each other file of the bundle, in hexadecimal."""
    start: FlowStart = "noise"
    """What its flow starts from."""
    sampler: SamplerName = "euler"
    """How its flow is integrated; `edge_runtime.policy.flow_steps` has both."""
    sampler_steps: int | None = None
    """The steps in which an action is made where they are others than `euler_steps`."""
    supersedes: tuple[str, ...] = ()
    """SHA-256 of earlier manifests of the same policy: logs made with those replay with this one."""

    @property
    def steps(self) -> int:
        """T, the steps in which an action is made."""
        return self.euler_steps if self.sampler_steps is None else self.sampler_steps
