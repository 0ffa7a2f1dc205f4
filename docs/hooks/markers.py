"""mkdocs hook: what a page takes from the code, written where a comment asks for it.

``<!-- file: module.Record -->`` becomes tables of all keys of a file that the record reads, ``<!-- kinds:
module.NAMES -->`` a table for each of several records, ``<!-- channels: module.NAMES -->`` those of a log,
``<!-- help -->`` the commands' own help.
"""

import re
from collections.abc import Callable
from importlib import import_module
from typing import Any, Final

from command_help import help_pages
from record_tables import channel_tables, file_tables, kind_tables

_MARKER: Final = re.compile(r"^<!-- (file|kinds|channels|help)(?:: ([\w.]+))? -->$", re.MULTILINE)
_WRITERS: Final[dict[str, Callable[..., str]]] = {
    "file": file_tables,
    "kinds": kind_tables,
    "channels": channel_tables,
    "help": help_pages,
}


def on_page_markdown(markdown: str, **_: object) -> str:
    """Fill in a page's comments; mkdocs calls this for each page."""
    return _MARKER.sub(_written, markdown)


def _written(marker: re.Match[str]) -> str:
    arguments = [_named(marker[2])] if marker[2] else []
    return _WRITERS[marker[1]](*arguments)


def _named(path: str) -> Any:  # noqa: ANN401  # whatever the page names
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)
