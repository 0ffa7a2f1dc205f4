"""Which sources of the user's own may run on a robot: those that its fleet file or its flags name."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from edge_runtime.config.fleet import Fleet
from edge_runtime.observation import Source
from edge_runtime.observation.own_source import own_source


def add_own_source(parser: argparse.ArgumentParser) -> None:
    """Add the flag that names one."""
    parser.add_argument(
        "--own-source",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="a source of your own that the policy may observe by, from this folder or installed; repeatable",
    )


def load_own_sources(fleet: Fleet | None, named: Sequence[str]) -> tuple[type[Source], ...]:
    """Import them, on the user's word alone: this executes their modules.

    Args:
        fleet: whose ``own_sources`` lie beside its file, or are installed.
        named: by flags; they lie in the working directory, or are installed.

    Raises:
        ConfigError: if one cannot be imported, or is no source.
    """
    kinds = [own_source(name, Path.cwd(), f"--own-source {name}") for name in named]
    if fleet is not None:
        folder = Path(os.path.realpath(fleet.path)).parent
        for index, name in enumerate(fleet.team.own_sources):
            kinds.append(own_source(name, folder, f"{fleet.path}: team.own_sources[{index}]"))
    return tuple(kinds)
