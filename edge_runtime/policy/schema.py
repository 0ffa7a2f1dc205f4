"""What a manifest must say for a robot to run it: fields of the right size, finite and ordered numbers."""

import re
from itertools import pairwise
from typing import Final, NoReturn

from edge_runtime.common.bounds import GREATEST, RATE_HZ
from edge_runtime.errors import BundleError
from edge_runtime.messages import LONGEST_ACTION
from edge_runtime.motion.body import Body
from edge_runtime.motion.models import MotionModel
from edge_runtime.observation import ObservationField
from edge_runtime.observation.source import LARGEST_FIELD
from edge_runtime.policy.manifest import Manifest, Spaces, Training

GRAPH_FILE: Final = "policy.onnx"
WEIGHTS_FILE: Final = "policy.npz"
MAX_STEPS: Final = 1000
MAX_RAYS: Final = 1024
MAX_LAYERS: Final = 16
"""As many as the compiled kernel takes."""
MAX_WIDTH: Final = 4096
MAX_FREQUENCIES: Final = 1024
"""Of flow time, beside flow time itself."""
MAX_WEIGHTS: Final = 4_000_000
"""A network of three layers of 256 has a thirtieth of it."""
LARGEST_FILE: Final = 8 * MAX_WEIGHTS
"""Bytes of a file of weights or of a graph."""
MAX_NAME: Final = 200
"""Characters of a name."""

_SHA256 = re.compile(r"[0-9a-f]{64}")


def bundle_files(runtime: str) -> tuple[str, ...]:
    """Files beside the manifest that a bundle for ``runtime`` has."""
    return (GRAPH_FILE, WEIGHTS_FILE) if runtime == "numpy" else (GRAPH_FILE,)


def check_manifest(manifest: Manifest, source: str) -> None:
    """Refuse a manifest that no robot could run.

    Args:
        manifest: the decoded manifest; its types are already right.
        source: the file to name in errors.

    Raises:
        BundleError: names the key, what was found and what fits.
    """
    rules = _Rules(source)
    rules.name("name", manifest.name)
    rules.between("control_rate_hz", manifest.control_rate_hz, *RATE_HZ)
    rules.between("euler_steps", manifest.euler_steps, 1, MAX_STEPS)
    rules.between("sampler_steps", manifest.steps, 1, MAX_STEPS)
    _check_body(rules, manifest.body)
    _check_motion(rules, manifest.motion)
    steps = manifest.motion.dt_s * manifest.control_rate_hz
    rules.require(abs(steps - 1.0) < 1e-6, "motion.dt_s", manifest.motion.dt_s, "1 / control_rate_hz")
    _check_action(rules, manifest)
    _check_observation(rules, manifest)
    _check_network(rules, manifest)
    if manifest.training is not None:
        check_training(manifest.training, source)
    _check_files(rules, manifest)


def check_training(training: Training, source: str) -> None:
    """Refuse an origin that no manifest can state.

    Args:
        training: the decoded origin; its types are already right.
        source: the file to name in errors.

    Raises:
        BundleError: names the key, what was found and what fits.
    """
    rules = _Rules(source)
    for field in ("scenario", "algorithm", "commit"):
        rules.name(f"training.{field}", getattr(training, field))
    rules.require(training.frames >= 0, "training.frames", training.frames, "at least 0")
    rules.between("training.score", training.score, 0, 1)


class _Rules:
    """Requirements on the keys of one file."""

    def __init__(self, source: str) -> None:
        self._source = source

    def refuse(self, key: str, found: object, wanted: str) -> NoReturn:
        raise BundleError(f"{self._source}: {key} is {found!r}, must be {wanted}")

    def require(self, fits: bool, key: str, found: object, wanted: str) -> None:
        if not fits:
            self.refuse(key, found, wanted)

    def name(self, key: str, value: str) -> None:
        fits = bool(value.strip()) and len(value) <= MAX_NAME and value.isprintable()
        self.require(fits, key, value[:MAX_NAME], f"a name of up to {MAX_NAME} printable characters")

    def positive(self, key: str, value: float) -> None:
        self.between(key, value, 1.0 / GREATEST, GREATEST)

    def bounded(self, key: str, value: float) -> None:
        self.between(key, value, -GREATEST, GREATEST)

    def between(self, key: str, value: float, low: float, high: float) -> None:
        self.require(low <= value <= high, key, value, f"between {low:g} and {high:g}")


def _check_body(rules: _Rules, body: Body) -> None:
    rules.positive("body.radius_m", body.radius_m)
    rules.between("body.lidar_rays", body.lidar_rays, 0, MAX_RAYS)
    if body.lidar_rays:
        rules.positive("body.lidar_range_m", body.lidar_range_m)
        rules.bounded("body.lidar_start_rad", body.lidar_start_rad)
    else:
        rules.require(body.lidar_range_m == 0, "body.lidar_range_m", body.lidar_range_m, "0 without rays")


def _check_motion(rules: _Rules, motion: MotionModel) -> None:
    for key, found, wanted in motion.faults():
        rules.refuse(f"motion.{key}", found, wanted)


def _check_observation(rules: _Rules, manifest: Manifest) -> None:
    seen: set[str] = set()
    rules.require(bool(manifest.observation), "observation", [], "a list of fields")
    for index, field in enumerate(manifest.observation):
        key = f"observation[{index}]"
        rules.name(f"{key}.name", field.name)
        rules.require(field.name not in seen, f"{key}.name", field.name, "named once, it is repeated")
        seen.add(field.name)
        _check_field(rules, key, field, manifest)


def _check_field(rules: _Rules, key: str, field: ObservationField, spaces: Spaces) -> None:
    size, unit, kind = field.components(spaces.extent), field.unit_here, field.kind
    rules.name(f"{key}.unit", field.unit)
    rules.require(field.unit == (unit or field.unit), f"{key}.unit", field.unit, f"{unit!r} for {kind}")
    if size is None:
        rules.between(f"{key}.size", field.size, 1, LARGEST_FIELD)
    else:
        rules.require(size > 0, f"{key}.source", kind, "left out, body.lidar_rays is 0")
        rules.require(field.size == size, f"{key}.size", field.size, f"{size} for {kind}")
    _check_seen(rules, f"{key}.seen", field)


def _check_seen(rules: _Rules, key: str, field: ObservationField) -> None:
    if field.seen is None:
        return
    count = len(field.seen)
    rules.require(count == field.size, key, count, f"{field.size} pairs of a least and a greatest value")
    for index, (low, high) in enumerate(field.seen):
        rules.bounded(f"{key}[{index}][0]", low)
        rules.between(f"{key}[{index}][1]", high, low, GREATEST)


def _check_action(rules: _Rules, manifest: Manifest) -> None:
    found, wanted = manifest.action_dim, manifest.motion.action_dim
    rules.between("action: number of components", found, 1, LONGEST_ACTION)
    rules.require(
        found == wanted, "action: number of components", found, f"{wanted} for {manifest.motion.kind}"
    )
    names = [field.name for field in manifest.action]
    for index, field in enumerate(manifest.action):
        for key in ("name", "unit"):
            rules.name(f"action[{index}].{key}", getattr(field, key))
        once = names.count(field.name) == 1
        rules.require(once, f"action[{index}].name", field.name, "named once, it is repeated")
        rules.bounded(f"action[{index}].low", field.low)
        rules.bounded(f"action[{index}].high", field.high)
        rules.require(
            field.low < field.high, f"action[{index}].low", field.low, f"below its high, {field.high}"
        )
        rules.require(field.low <= 0.0, f"action[{index}].low", field.low, "at most 0, which is rest")
        rules.require(field.high >= 0.0, f"action[{index}].high", field.high, "at least 0, which is rest")


def _check_network(rules: _Rules, manifest: Manifest) -> None:
    network = manifest.network
    if manifest.runtime == "onnxruntime":
        rules.require(network is None, "network", network, "null for runtime 'onnxruntime'")
        return
    if network is None:
        rules.refuse("network", None, "given for runtime 'numpy'")
    hidden = network.hidden
    rules.between("network.hidden: number of layers", len(hidden), 1, MAX_LAYERS)
    for layer, width in enumerate(hidden):
        rules.between(f"network.hidden[{layer}]", width, 1, MAX_WIDTH)
    weights = sum(before * after for before, after in pairwise((manifest.observation_dim, *hidden)))
    rules.between("network.hidden: number of weights", weights, 1, MAX_WEIGHTS)
    if network.prior_std is not None:
        rules.positive("network.prior_std", network.prior_std)


def _check_files(rules: _Rules, manifest: Manifest) -> None:
    for index, digest in enumerate(manifest.supersedes):
        fits = _SHA256.fullmatch(digest) is not None
        rules.require(fits, f"supersedes[{index}]", digest, "a SHA-256 of 64 hexadecimal digits")
    wanted = bundle_files(manifest.runtime)
    fits = sorted(manifest.files) == sorted(wanted)
    rules.require(fits, "files", sorted(manifest.files), f"{', '.join(wanted)} for {manifest.runtime!r}")
    for name, digest in manifest.files.items():
        fits = _SHA256.fullmatch(digest) is not None
        rules.require(fits, f"files.{name}", digest, "a SHA-256 of 64 hexadecimal digits")
