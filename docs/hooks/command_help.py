"""The help of every command, as the commands themselves print it."""

import os
from typing import Final

from edge_runtime.completion.completion import parsers
from edge_runtime.doctor import edge_doctor

WIDTH: Final = 110
"""Characters of a line."""


def help_pages() -> str:
    """A section for each command that runs where the pages are built."""
    os.environ["COLUMNS"] = str(WIDTH)
    pages = []
    for parser in parsers():
        if parser.prog == "edge-doctor":  # completion needs its flags alone, which are edge-run's
            parser.description, parser.epilog = edge_doctor.DESCRIPTION, edge_doctor.EPILOG
        pages.append(f"## {parser.prog}\n\n```text\n{parser.format_help()}```\n")
    return "\n".join(pages)
