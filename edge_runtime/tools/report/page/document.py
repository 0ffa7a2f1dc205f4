"""What a page holds, and its HTML: nothing is fetched, no script runs."""

import html
import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

import msgspec

from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page.theme import own_ids

STYLE: Final = "page.css"
NUMBER: Final = re.compile(r"[-+]?[\d,]*\.?\d+(e[-+]?\d+)?( [%x])?( ± [\d.]+)?")


class Figure(msgspec.Struct, frozen=True):
    """A drawing with the sentence that says how to read it."""

    svg: str
    """As `edge_runtime.tools.report.page.theme.to_svg` returns it."""
    caption: str
    wide: bool = False
    """Takes the whole width of the page."""


class Table(msgspec.Struct, frozen=True):
    """Rows of text; a cell that holds a number is set to the right."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


class Facts(msgspec.Struct, frozen=True):
    """Names and values, such as versions."""

    pairs: Sequence[tuple[str, str]]


class Note(msgspec.Struct, frozen=True):
    """A paragraph; a warning stands out."""

    text: str
    warning: bool = False


class Verdict(msgspec.Struct, frozen=True):
    """One number of the page's head, with whether it is as it should be; None where it is neither."""

    name: str
    value: str
    detail: str = ""
    good: bool | None = None


Item = Figure | Table | Facts | Note


class Section(msgspec.Struct, frozen=True):
    """A heading and what stands under it."""

    title: str
    items: Sequence[Item]


class Page(msgspec.Struct, frozen=True):
    """A whole page."""

    title: str
    subtitle: str
    verdicts: Sequence[Verdict]
    sections: Sequence[Section]


def write_page(page: Page, path: Path) -> None:
    """Write a page.

    Raises:
        ConfigError: if the system does not take it.
    """
    try:
        path.write_text(render(page), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror})") from error


def render(page: Page) -> str:
    """Return a page's HTML."""
    style = files(__package__).joinpath(STYLE).read_text(encoding="utf-8")
    contents = "".join(
        f'<a href="#s{index}">{_text(section.title)}</a>' for index, section in enumerate(page.sections)
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'  # or the browser asks the server for one
        f"<title>{_text(page.title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"<header>\n<h1>{_text(page.title)}</h1>\n<p>{_text(page.subtitle)}</p>\n</header>\n"
        f'<div class="verdicts">{"".join(map(_verdict, page.verdicts))}</div>\n'
        f"<nav>{contents}</nav>\n<main>\n"
        + "".join(_section(index, section) for index, section in enumerate(page.sections))
        + "</main>\n</body>\n</html>\n"
    )


def _verdict(verdict: Verdict) -> str:
    kind = {True: "good", False: "bad", None: "plain"}[verdict.good]
    mark = {True: "✓ ", False: "✗ ", None: ""}[verdict.good]
    return (
        f'<div class="verdict {kind}"><b>{_text(verdict.name)}</b>'
        f"<span>{mark}{_text(verdict.value)}</span><small>{_text(verdict.detail)}</small></div>"
    )


def _section(index: int, section: Section) -> str:
    items = "".join(_item(item, f"s{index}-{place}-") for place, item in enumerate(section.items))
    title = f'<section id="s{index}">\n<h2>{_text(section.title)}</h2>\n'
    return f'{title}<div class="items">{items}</div>\n</section>\n'


def _item(item: Item, prefix: str) -> str:
    if isinstance(item, Figure):
        return _figure(item, prefix)
    if isinstance(item, Table):
        return _table(item)
    if isinstance(item, Facts):
        pairs = "".join(f"<dt>{_text(name)}</dt><dd>{_text(value)}</dd>" for name, value in item.pairs)
        return f"<dl>{pairs}</dl>\n"
    return f'<p class="{"warning" if item.warning else "note"}">{_text(item.text)}</p>\n'


def _figure(figure: Figure, prefix: str) -> str:
    caption = _text(figure.caption)
    kind = ' class="wide"' if figure.wide else ""
    drawing = f'<div role="img" aria-label="{caption}">{own_ids(figure.svg, prefix)}</div>'
    return f"<figure{kind}>{drawing}<figcaption>{caption}</figcaption></figure>\n"


def _table(table: Table) -> str:
    head = "".join(f'<th scope="col">{_text(cell)}</th>' for cell in table.head)
    rows = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in table.rows)
    caption = f"<caption>{_text(table.caption)}</caption>" if table.caption else ""
    body = f"{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    return f'<div class="table"><table>{body}</table></div>\n'


def _cell(text: str) -> str:
    kind = ' class="number"' if NUMBER.fullmatch(text) else ""
    return f"<td{kind}>{_text(text)}</td>"


def _text(text: str) -> str:
    return html.escape(text, quote=True)
