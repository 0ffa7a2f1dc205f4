"""The page: nothing from outside, nothing that text could break, drawings that belong to it."""

import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_runtime.common.command_line import check_writable
from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page.document import (
    Facts,
    Figure,
    Note,
    Page,
    Section,
    Table,
    Verdict,
    render,
)

pytest.importorskip("matplotlib")

from edge_runtime.tools.report.page import arena, chart  # needs matplotlib when it draws

TIME_S = np.arange(5000) / 100.0
VOID = ("meta", "link", "br", "path", "use", "rect")


class Reader(HTMLParser):
    """Collects what a page says, and that its elements close."""

    def __init__(self):
        super().__init__()
        self.open, self.text, self.ids, self.links = [], [], [], []

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        if tag not in VOID:
            self.open.append(tag)
        self.ids += [named["id"]] if "id" in named else []
        self.links += [named[key] for key in ("src", "href", "xlink:href") if key in named]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def read(page):
    reader = Reader()
    reader.feed(render(page))
    assert not reader.open
    return reader


def page_of(*items):
    return Page(
        "A run", "of robots", (Verdict("Speed", "0.3 m/s", "limit", good=True),), (Section("One", items),)
    )


DRAWN = chart.over_time(
    {"robot 0": (TIME_S, np.sin(TIME_S))}, "speed in m/s", [chart.Limit(0.5, "limit 0.5 m/s")]
)
MAP = arena.arena(
    [arena.Track("robot 0", np.array([[0.0, 0.0], [np.nan, np.nan], [1.0, 1.0]]), (1.0, 1.0), 0.1)],
    [arena.Circle((0.5, 0.5), 0.2, "geofence")],
    0.1,
)


@given(st.text(), st.text())
def test_text_stays_text(one, other):
    hostile = f"<script>{one}</script>"
    items = (Table((hostile,), ((other,),)), Facts(((one, hostile),)), Note(other, warning=True))
    reader = read(page_of(*items))
    assert "script" not in reader.open
    told = "".join(reader.text).replace("\r", "")
    assert hostile.replace("\r", "").replace("\0", "�") in told.replace("\0", "�")


def test_a_page_fetches_nothing_and_has_each_id_once():
    reader = read(page_of(Figure(DRAWN, "one"), Figure(DRAWN, "two"), Figure(MAP, "three")))
    assert len(set(reader.ids)) == len(reader.ids) > 10
    assert all(link.startswith(("#", "data:")) for link in reader.links)
    assert {link[1:] for link in reader.links if link.startswith("#")} <= set(reader.ids)
    text = render(page_of(Figure(DRAWN, "one")))
    assert "<script" not in text
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    assert set(re.findall(r"https?://[^\"'\s>]+", text)) <= {
        "http://www.w3.org/2000/svg",
        "http://www.w3.org/1999/xlink",
    }


def test_drawings_follow_the_page():
    for svg in (DRAWN, MAP):
        root = ET.fromstring(svg)  # noqa: S314  # our own
        assert "width" not in root.attrib
        assert "viewBox" in root.attrib
        assert "var(--ink)" in svg
        assert "var(--limit)" in svg
        assert "var(--sans)" in svg
        assert "#0102" not in svg
        assert "DejaVu" not in svg


def test_what_a_chart_says_is_in_it():
    for text in ("speed in m/s", "time in s", "limit 0.5 m/s"):
        assert text in DRAWN
    for text in ("x in m", "y in m", "geofence"):
        assert text in MAP


@pytest.mark.parametrize("count", [0, 1, 1000, 100_000])
def test_a_long_line_keeps_its_peaks(count):
    values = np.random.default_rng(count).standard_normal(count)
    time_s, kept = chart.thinned(np.arange(count, dtype=float), values)
    assert len(kept) <= 2 * chart.MOST_POINTS
    assert (np.diff(time_s) > 0).all()
    if count:
        assert (kept.min(), kept.max()) == (values.min(), values.max())


def test_gaps_are_no_peaks():
    values = np.full(10_000, np.nan)
    values[5000] = 3.0
    _, kept = chart.thinned(np.arange(10_000.0), values)
    assert np.nanmax(kept) == 3.0


@pytest.mark.parametrize(
    "draw",
    [
        lambda: chart.over_time({}, "nothing"),
        lambda: chart.over_time({"robot 0": (np.zeros(0), np.zeros(0))}, "nothing"),
        lambda: chart.histograms({"tick": np.zeros(0)}, "ms"),
        lambda: chart.histograms({"tick": np.zeros(9), "act": np.ones(9)}, "ms"),
        lambda: chart.bars({}, "share"),
        lambda: chart.bars({"robot 0": {}, "robot 1": {"speed": 1.0}}, "share"),
        lambda: chart.timeline(["robot 0"], [], [], 0.0),
        lambda: chart.timeline(
            ["robot 0"], [chart.Span("robot 0", 1, 1, "rest")], [("robot 0", 2, "miss")], 3.0
        ),
        lambda: arena.arena([]),
    ],
)
def test_little_or_nothing_is_drawn_too(draw):
    assert ET.fromstring(draw()).tag.endswith("svg")  # noqa: S314  # our own


def test_an_output_that_cannot_be_written_fails_first(tmp_path):
    with pytest.raises(ConfigError, match="cannot be written"):
        check_writable(tmp_path / "no" / "page.html")
