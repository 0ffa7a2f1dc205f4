"""The moving pictures of the README: they end when guidance has satisfied everything, or in time."""

import pytest
from PIL import Image

from benchmarks import pictures
from benchmarks.pictures import draw, main
from edge_runtime.errors import ConfigError
from export.episodes.neighbourhood import Setting

FEW = Setting(episodes=2, episodes_seed=3)


def seconds(path):
    """How long a picture moves, without the moment that its end is held."""
    with Image.open(path) as picture:
        lengths = []
        for frame in range(picture.n_frames):
            picture.seek(frame)
            lengths.append(picture.info["duration"])
    return sum(lengths[:-1]) / 1000


def test_a_picture_ends_when_its_robots_have_arrived_or_its_time_is_up(tmp_path, monkeypatch):
    lengths = []
    for longest in (2.0, 15.0):
        path = tmp_path / f"{longest}.gif"
        monkeypatch.setitem(pictures.LONGEST_S, "navigation", longest)
        draw("navigation", path, FEW)
        lengths.append(seconds(path))
    assert lengths[0] < lengths[1] < 14.0


def test_an_unknown_task_is_refused_by_name(tmp_path):
    with pytest.raises(ConfigError, match="unknown task 'chess': choose from navigation, balance, sampling"):
        main(["chess", "--out", str(tmp_path)])
    assert not list(tmp_path.iterdir())
