"""``python -m benchmarks page``: a Markdown page of results, and what it draws, as one file of HTML.

Benchmarks tell their results in Markdown: headings, paragraphs, bullets, tables and pictures, nothing else.
From that, `make_page` composes the kind of page that edge-report and edge-sil write: it fetches nothing and
runs no script. A benchmark that has rows needs only a text:

    # Title

    What it was written by.

    ## A section

    | case | p99 us |
    |---|--:|
    | off | 12.3 |

    ![how to read it](drawn.svg)
"""

import argparse
import base64
import re
import struct
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from benchmarks.common.flags import make_parser
from edge_runtime.common.command_line import check_writable
from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page.document import (
    Figure,
    Item,
    Note,
    Page,
    Section,
    Table,
    Verdict,
    write_page,
)

NO_DRAWINGS: Final[Mapping[str, str]] = {}
PICTURE: Final = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)")
_PNG: Final = b"\x89PNG\r\n\x1a\n"


def add_html_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--html``."""
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="write a page there that fetches nothing and runs no script"
    )


def make_page(
    text: str,
    folder: Path = Path(),
    drawings: Mapping[str, str] = NO_DRAWINGS,
    verdicts: Sequence[Verdict] = (),
) -> Page:
    """Compose a page from Markdown.

    Args:
        text: the first heading is the page's title, the first paragraph its subtitle, every other heading a
            section's. A paragraph that begins in bold is a warning.
        folder: where pictures lie, PNG or SVG.
        drawings: SVG by the name that the text calls it; looked up before the folder.
        verdicts: numbers for the page's head.

    Raises:
        ConfigError: if a picture cannot be read.
    """
    title = subtitle = parent = ""
    sections: list[tuple[str, list[Item]]] = [("The run", [])]
    for lines in _blocks(text):
        heading = re.fullmatch(r"(#+) (.*)", lines[0])
        if heading:
            name, depth = _plain(heading[2]), len(heading[1])
            parent = parent if depth > 2 else name
            title = title or name
            if depth > 1:
                sections.append((name if depth == 2 else f"{parent}: {name}", []))
        elif not subtitle and not lines[0].startswith(("|", "- ", "!", "**")):
            subtitle = _plain(" ".join(lines))
        else:
            sections[-1][1].extend(_items(lines, folder, drawings))
    return Page(title, subtitle, verdicts, [Section(name, items) for name, items in sections if items])


def page(title: str, command: str, *parts: str) -> str:
    """Return the Markdown of a whole page, less what is empty."""
    written = f"Written by `python -m benchmarks {command}`."
    return "\n\n".join([f"# {title}", written, *filter(None, parts)]) + "\n"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; all columns but the first hold numbers."""
    return "\n".join([table_head(header), *map(table_line, rows)])


def table_head(header: Sequence[str]) -> str:
    """Return the first two lines of a table."""
    return "\n".join([table_line(header), table_line(["---", *["--:"] * (len(header) - 1)])])


def table_line(cells: Sequence[str]) -> str:
    """Return one line of a table."""
    return "| " + " | ".join(cells) + " |"


def main(arguments: Sequence[str]) -> int:
    """Write the page of one Markdown file."""
    parser = make_parser("page", __doc__)
    parser.add_argument("markdown", type=Path, help="such as benchmarks/results/latency/latency.md")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    flags = parser.parse_args(arguments)
    check_writable(flags.output)
    text = _read(flags.markdown).decode()
    write_page(make_page(text, flags.markdown.parent), flags.output)
    return 0


def _blocks(text: str) -> list[list[str]]:
    """The lines of each paragraph, list, table, picture and heading."""
    kinds = groupby(enumerate(text.splitlines()), key=lambda each: _kind(*each))
    return [[line for _, line in lines] for kind, lines in kinds if kind[0]]


def _kind(number: int, line: str) -> tuple[str, int]:
    """What a line belongs to; headings and pictures are alone."""
    first = line[:1]
    if not line.strip():
        return "", 0
    if first in "#!":
        return first, number
    return (first if first == "|" else "- " if line.startswith("- ") else "text"), 0


def _items(lines: Sequence[str], folder: Path, drawings: Mapping[str, str]) -> list[Item]:
    picture = PICTURE.fullmatch(lines[0].strip())
    if picture:
        return [Figure(_drawing(picture[2], folder, drawings), picture[1])]
    if lines[0].startswith("|"):
        head, *rows = ([_plain(cell) for cell in line.strip().strip("|").split("|")] for line in lines)
        return [Table(head, [row for row in rows if set("".join(row)) - set("-: ")])]
    if lines[0].startswith("- "):
        return [Note(_plain(line[2:])) for line in lines]
    return [Note(_plain(" ".join(lines)), warning=lines[0].startswith("**"))]


def _plain(text: str) -> str:
    """Text without Markdown's marks for bold, code and links."""
    return re.sub(r"\*\*|`", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)).strip()


def _drawing(name: str, folder: Path, drawings: Mapping[str, str]) -> str:
    """A picture as SVG that stands within the page."""
    if name in drawings:
        return drawings[name]
    content = _read(folder / name)
    if content.startswith(_PNG):
        width, height = struct.unpack(">II", content[16:24])
        source = base64.b64encode(content).decode()
        return (
            f'<svg viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">'
            f'<image width="{width}" height="{height}" href="data:image/png;base64,{source}"/></svg>'
        )
    svg = content.decode(errors="replace")
    if "<svg" not in svg:
        raise ConfigError(f"{folder / name}: is neither PNG nor SVG")
    return svg[svg.index("<svg") :]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
