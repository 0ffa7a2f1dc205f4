"""Benchmarks' pages: Markdown of their rows becomes one file that fetches nothing."""

import base64
import re

import pytest
from paths import ROOT

from benchmarks.common.result_file import read_result
from benchmarks.common.result_page import main, make_page, table
from benchmarks.faults.rows import FaultRow
from benchmarks.faults.rows import draw as draw_faults
from benchmarks.faults.rows import render as render_faults
from benchmarks.recording.rows import Overhead
from benchmarks.recording.rows import draw as draw_recording
from benchmarks.recording.rows import render as render_recording
from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page.document import Figure, Note, Table, Verdict, render

RESULTS = ROOT / "benchmarks" / "results"
TEXT = """\
# A *thing*, measured

Written by `python -m benchmarks thing`, see
[there](there.md).

**INVALID: the machine was busy.**

- processor: fast
- kernel: new

## First

| case | p99 us |
|---|--:|
| <off> | 12.3 |
| **on** | 12,345.0 |
![how to read it](drawn.svg)

## Empty

### Part

Words
of a paragraph.
"""
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAADCAAAAADL8Mp1AAAADklEQVR4nGP4z8AAQmAEABfoAvzXQAKDAAAAAElFTkSuQmCC"
)


def links(html):
    return re.findall(r'(?:src|href)\s*=\s*"([^"]*)"|url\(([^)]*)\)', html)


def fetches_nothing(html):
    assert "<script" not in html
    return all((one or other).startswith(("#", "data:")) for one, other in links(html))


def test_markdown_becomes_a_page():
    page = make_page(TEXT, drawings={"drawn.svg": "<svg/>"}, verdicts=[Verdict("p99", "12.3")])
    assert (page.title, page.subtitle) == (
        "A *thing*, measured",
        "Written by python -m benchmarks thing, see there.",
    )
    run, first, part = page.sections
    assert run.items == [
        Note("INVALID: the machine was busy.", warning=True),
        Note("processor: fast"),
        Note("kernel: new"),
    ]
    assert first.items == [
        Table(["case", "p99 us"], [["<off>", "12.3"], ["on", "12,345.0"]]),
        Figure("<svg/>", "how to read it"),
    ]
    assert (part.title, part.items) == ("Empty: Part", [Note("Words of a paragraph.")])
    html = render(page)
    assert "&lt;off&gt;" in html
    assert fetches_nothing(html)


def test_a_table_reads_back():
    rows = [["a", "1.0"], ["b", ""]]
    (section,) = make_page("# t\n\ns\n\n## x\n" + table(["case", "us"], rows)).sections
    assert section.items == [Table(["case", "us"], rows)]


def test_pictures_are_taken_into_the_page(tmp_path):
    (tmp_path / "dot.png").write_bytes(PIXEL)
    (tmp_path / "dot.svg").write_text('<?xml version="1.0"?>\n<svg viewBox="0 0 1 1"><path id="a"/></svg>')
    html = render(make_page("# t\n\ns\n\n![a](dot.png)\n![b](dot.svg)\n", tmp_path))
    assert 'viewBox="0 0 2 3"' in html
    assert base64.b64encode(PIXEL).decode() in html
    assert "<?xml" not in html
    assert fetches_nothing(html)


@pytest.mark.parametrize("name", ["none.png", "text.png"])
def test_what_is_no_picture_is_refused(name, tmp_path):
    (tmp_path / "text.png").write_text("text")
    with pytest.raises(ConfigError, match=name):
        make_page(f"# t\n\n![a]({name})", tmp_path)


def test_the_recorded_latency_page_becomes_one_file(tmp_path):
    assert main([str(RESULTS / "latency" / "latency.md"), "-o", str(tmp_path / "page.html")]) == 0
    html = (tmp_path / "page.html").read_text()
    assert html.count("<figure") == len(list((RESULTS / "latency").glob("*.png")))
    assert fetches_nothing(html)


def test_the_recorded_rows_become_pages():
    pytest.importorskip("matplotlib")
    faults = read_result(RESULTS / "faults.json", list[FaultRow])
    recorded = read_result(RESULTS / "recording.json", Overhead)
    rows = recorded.rows
    for text, drawings, names in (
        (render_faults(faults), {"stops.svg": draw_faults(faults)}, {row.fault for row in faults}),
        (render_recording(recorded), {"ticks.svg": draw_recording(rows)}, {r.quantity for r in rows}),
    ):
        page = make_page(text, drawings=drawings)
        items = [item for section in page.sections for item in section.items]
        shown = next(item for item in items if isinstance(item, Table))
        assert {row[0] for row in shown.rows} == names
        assert fetches_nothing(render(page))


def test_faults_that_were_only_counted_are_not_drawn():
    pytest.importorskip("matplotlib")
    drawn = draw_faults([FaultRow("counted", "can", 5, passed=0), FaultRow("timed", "can", 5, 1.0, 2.0, 3.0)])
    assert "timed" in drawn
    assert "counted" not in drawn
