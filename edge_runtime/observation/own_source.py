"""A source of the user's own: the field names its class, and the robot decides whether it may run."""

from collections.abc import Collection
from pathlib import Path

import msgspec

from edge_runtime.common.own_code import own_class, own_faults, own_name
from edge_runtime.common.toml_file import Table, refuse, to_record
from edge_runtime.observation.source import Name, Source


class OwnSource(Source, frozen=True, kw_only=True, tag="own"):
    """What a class of your own returns, of those that the robot's fleet file or its flags allow."""

    code: Name
    """Its class, as ``module:Class``."""
    parameters: Table = msgspec.field(default_factory=dict)
    """Of the class's own fields."""

    def made(self, own: Collection[type[Source]], source: str, key: str) -> Source:
        """Return the field as an object of its class.

        Args:
            own: the classes that the robot allows.
            source: the file that holds the field, for errors.
            key: of the field in it.

        Raises:
            ConfigError: if the class is not allowed, or cannot be made of the parameters.
        """
        allowed = {own_name(kind): kind for kind in own}
        path = Path(source)
        if self.code not in allowed:
            refuse(
                path,
                f"{key}.code",
                f"{self.code!r} is code that no bundle can make run here; allowed: "
                f"{', '.join(allowed) or 'none'}; name it as own_sources in the fleet file's [team], or with "
                f"--own-source {self.code}",
            )
        kind = allowed[self.code]
        config = kind.__struct_config__
        table = {**self.parameters, "name": self.name, "size": self.size, "unit": self.unit}
        with own_faults(f"{path}: {key}", f"{self.code!r} cannot be made"):
            return to_record({**table, str(config.tag_field): config.tag}, kind, path, key)


def own_source(name: str, folder: Path, source: str) -> type[Source]:
    """Import a user's own source, on the user's word alone: this executes its module.

    Args:
        name: ``module:Class``.
        folder: where the module may lie, if it is not installed.
        source: what named it, for errors.

    Raises:
        ConfigError: if it cannot be imported, or is no source.
    """
    return own_class(name, folder, source, Source, "read(view)")
