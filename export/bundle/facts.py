"""What a velocity field alone does not say: fields, limits, rate, motion and body of its robots."""

from pathlib import Path

import msgspec
from msgspec.structs import replace

from edge_runtime.common.toml_file import Table, read_toml, refuse, to_record
from edge_runtime.motion.body import Body
from edge_runtime.motion.models import MotionModel
from edge_runtime.observation import SOURCES, Extent, ObservationField
from edge_runtime.policy.flow_steps import SamplerName
from edge_runtime.policy.manifest import (
    BUNDLE_FORMAT,
    ActionField,
    FlowStart,
    Manifest,
    Network,
    Spaces,
    Training,
)
from edge_runtime.policy.schema import GRAPH_FILE, check_manifest


class Facts(Spaces, msgspec.Struct, frozen=True):
    """The part of a manifest that is known before any file is written."""

    observation: tuple[ObservationField, ...]
    action: tuple[ActionField, ...]
    control_rate_hz: float
    euler_steps: int
    motion: MotionModel
    body: Body
    training: Training | None = None
    start: FlowStart = "noise"
    sampler: SamplerName = "euler"
    sampler_steps: int | None = None

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
            motion=self.motion,
            body=self.body,
            training=self.training,
            files=files,
            start=self.start,
            sampler=self.sampler,
            sampler_steps=self.sampler_steps,
        )


class _FactsFile(Spaces, msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    observation: tuple[str | Table, ...]
    control_rate_hz: float
    euler_steps: int
    action: tuple[ActionField, ...]
    motion: MotionModel
    body: Body
    sampler: SamplerName = "euler"
    sampler_steps: int | None = None


def read_facts(path: Path) -> Facts:
    """Read a TOML file such as `export.bundle.facts_template` prints.

    Raises:
        ConfigError: if the file cannot be read or a key is missing, unknown or of the wrong type.
        BundleError: if a value fits no robot; names the key and what fits.
    """
    file = to_record(read_toml(path), _FactsFile, path)
    observation = tuple(
        _field(
            {"source": said} if isinstance(said, str) else said, file.extent, path, f"observation[{index}]"
        )
        for index, said in enumerate(file.observation)
    )
    rest = {name: getattr(file, name) for name in file.__struct_fields__ if name != "observation"}
    facts = Facts(observation, **rest)
    check_manifest(facts.manifest("facts", None, {GRAPH_FILE: "0" * 64}), str(path))
    return facts


def _field(table: Table, extent: Extent, path: Path, key: str) -> ObservationField:
    """A field of which the file need not say what its source says: a name, the unit, the size."""
    known = {str(kind.__struct_config__.tag): kind for kind in SOURCES}
    source = table.get("source")
    kind = known.get(source) if isinstance(source, str) else None
    if kind is None:
        return to_record(table, ObservationField, path, key)  # says what is allowed
    field = to_record({"name": source, "unit": kind.unit_here or "1", "size": 0, **table}, kind, path, key)
    if "size" in table:
        return field
    size = field.components(extent)
    if size is None:
        refuse(path, f"{key}.size", f"missing: how many numbers {source!r} gives is for you to say")
    return replace(field, size=size)
