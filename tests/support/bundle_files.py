"""A small bundle written without the exporter, and the means to tamper with it."""

import hashlib
import json

import msgspec
from networks import random_weights

from edge_runtime.motion.body import Body
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import GoalOffset, Position, Proximity, Velocity
from edge_runtime.policy.bundle import digest_line
from edge_runtime.policy.manifest import (
    BUNDLE_FORMAT,
    ActionField,
    Manifest,
    Network,
    Training,
)
from edge_runtime.policy.weight_file import pack_weights

WEIGHTS = random_weights(observation_dim=18, hidden=(8, 6))
MANIFEST = Manifest(
    format=BUNDLE_FORMAT,
    name="tiny",
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
    network=Network("silu", (8, 6), 0.5),
    motion=PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2),
    body=Body(radius_m=0.1, lidar_rays=12, lidar_range_m=0.35),
    training=Training("navigation", "mafpo", 0, 1000, "abc", 0.9),
    files={},
)


def write_bundle(directory, weights=None, graph=b"a graph", manifest=MANIFEST):
    """Write a bundle whose digests are right, whatever it holds."""
    directory.mkdir(exist_ok=True)
    contents = {"policy.onnx": graph, "policy.npz": weights or pack_weights(WEIGHTS)}
    if manifest.runtime == "onnxruntime":
        del contents["policy.npz"]
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    manifest = msgspec.structs.replace(manifest, files=digests)
    for name, content in contents.items():
        (directory / name).write_bytes(content)
    sign(directory, msgspec.json.format(msgspec.json.encode(manifest)))
    return directory


def sign(directory, manifest: bytes):
    (directory / "manifest.json").write_bytes(manifest)
    (directory / "manifest.sha256").write_bytes(digest_line(manifest))


def edit_manifest(directory, path, value):
    """Set one key, named like ``observation.0.unit``, and sign the result."""
    tree = json.loads((directory / "manifest.json").read_bytes())
    *parents, last = [int(part) if part.isdigit() else part for part in path.split(".")]
    node = tree
    for part in parents:
        node = node[part]
    node[last] = value
    sign(directory, json.dumps(tree).encode())
