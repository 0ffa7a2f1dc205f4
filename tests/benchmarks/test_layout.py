"""The layout for Foxglove: every panel has a place, and every path that it plots is in a log."""

import json

import pytest
from logs import record

from benchmarks import layout
from edge_runtime.recording.schema import CHANNELS

LAYOUT = json.loads(layout.LAYOUT.read_text())
PATHS = [line["value"] for panel in LAYOUT["configById"].values() for line in panel.get("paths", ())]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("log"), "--duration", "0.5")
    return path


def test_every_panel_has_a_place_and_the_places_fill_the_whole():
    places = dict(layout.places(LAYOUT["layout"]))
    assert set(places) == set(LAYOUT["configById"])
    assert sum(place.width * place.height for place in places.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("path", PATHS)
def test_what_is_plotted_is_a_number_in_every_tick(path, log):
    times, rows = layout.series(layout.read_messages(log), path)
    assert len(times) > 1
    assert all(row and all(isinstance(value, int | float) for value in row) for row in rows)


def test_every_topic_is_a_channel_of_a_log():
    panels = LAYOUT["configById"].values()
    topics = {key for panel in panels for key in panel.get("topics", ())}
    topics |= {panel[key] for panel in panels for key in ("topicToRender", "topicPath") if key in panel}
    topics |= {"/" + path[1:].partition(".")[0] for path in PATHS}
    assert topics <= {f"/{name}" for name in CHANNELS}


def test_a_log_is_drawn(log, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "layout.png"
    assert layout.main([str(log), "-o", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
