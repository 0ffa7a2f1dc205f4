"""Bundles for the tests: a hand-made policy that drives straight to its goal, written as files."""

import hashlib
from pathlib import Path

import msgspec
import numpy as np

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import GoalOffset, Position, Proximity, Velocity
from edge_runtime.policy.bundle import DIGEST_FILE, MANIFEST_FILE, digest_line
from edge_runtime.policy.manifest import BUNDLE_FORMAT, ActionField, Manifest, Network
from edge_runtime.policy.weight_file import pack_weights
from edge_runtime.policy.weights import FlowWeights

MANIFEST = Manifest(
    format=BUNDLE_FORMAT,
    name="straight",
    runtime="numpy",
    observation=(
        Position("position", 2, "m"),
        Velocity("velocity", 2, "m/s"),
        GoalOffset("goal_offset", 2, "m"),
        Proximity("proximity", 12, "m"),
    ),
    action=(ActionField("force_x", "N", -1.0, 1.0), ActionField("force_y", "N", -1.0, 1.0)),
    control_rate_hz=10.0,
    euler_steps=10,
    network=Network("tanh", (2,), None),
    motion=PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),
    body=Body(radius_m=0.1, lidar_rays=12, lidar_range_m=0.35),
    training=None,
    files={},
)


def straight_weights() -> FlowWeights:
    """A velocity field that carries the origin to the force 2 tanh(-goal_offset), wherever it stands."""
    observation = np.zeros((18, 2), np.float32)
    observation[4, 0] = observation[5, 1] = -1.0
    return FlowWeights(
        activation="tanh",
        action=np.zeros((2, 2), np.float32),
        observation=observation,
        time=np.zeros((1, 2), np.float32),
        time_frequency=np.zeros(0, np.float32),
        time_phase=np.zeros(0, np.float32),
        matrices=(2.0 * np.eye(2, dtype=np.float32),),
        biases=(np.zeros(2, np.float32), np.zeros(2, np.float32)),
    )


def write_straight_bundle(directory: Path, manifest: Manifest = MANIFEST) -> Path:
    """Write the straight policy as a bundle that the numpy runtime loads."""
    directory.mkdir()
    contents = {
        "policy.npz": pack_weights(straight_weights()),
        "policy.onnx": b"not used by the numpy runtime",
    }
    for name, content in contents.items():
        (directory / name).write_bytes(content)
    files = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    encoded = msgspec.json.encode(msgspec.structs.replace(manifest, files=files))
    (directory / MANIFEST_FILE).write_bytes(encoded)
    (directory / DIGEST_FILE).write_bytes(digest_line(encoded))
    return directory
