"""Moving pictures: what they show moves, what cannot be drawn is refused before the work starts."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from report_files import record

from edge_runtime.errors import ConfigError
from edge_runtime.tools.report.page.animation import MOST_FRAMES, Scene, animate, check_target

pytest.importorskip("matplotlib")
Image = pytest.importorskip("PIL.Image")


def scene(ticks=30, robots=2, speed=0.2):
    time_s = 0.1 * np.arange(ticks)
    position = np.zeros((ticks, robots, 2))
    position[..., 0] = speed * time_s[:, None]
    position[..., 1] = np.arange(robots)
    velocity = np.broadcast_to((speed, 0.0), position.shape)
    goals = [(speed * time_s[-1], float(robot)) for robot in range(robots)]
    return Scene("a team", 0.1, position, velocity, goals, 0.1, speed_limit_m_s=0.3, margin_m=0.25)


def frames(path):
    with Image.open(path) as picture:
        for index in range(picture.n_frames):
            picture.seek(index)
            yield np.asarray(picture.convert("RGB"), int)


def test_a_scene_moves_from_its_start_to_its_end(tmp_path):
    animate([scene(), scene(speed=0.5)], tmp_path / "two.gif")
    shown = list(frames(tmp_path / "two.gif"))
    assert 10 <= len(shown) <= MOST_FRAMES
    assert len({frame.shape for frame in shown}) == 1
    left, right = np.array_split(shown[-1], 2, axis=1)
    vermilion = [(abs(half - (0xD5, 0x5E, 0x00)).max(-1) < 40).sum() for half in (left, right)]
    assert vermilion[1] > 2 * vermilion[0]  # who breaks the limit is filled with it
    assert (shown[0] != shown[-1]).any()


def test_a_long_run_stays_small_and_a_robot_may_be_unseen(tmp_path):
    long = scene(ticks=5000, robots=6)
    long.position_m[:2500, 3] = np.nan
    animate([long], tmp_path / "long.gif")
    assert (tmp_path / "long.gif").stat().st_size < 1_500_000
    assert len(list(frames(tmp_path / "long.gif"))) <= MOST_FRAMES


@pytest.mark.parametrize(
    "name, expected", [("run.avi", "ends in .gif or .mp4"), ("no/run.gif", "cannot be written")]
)
def test_what_cannot_be_drawn_is_refused_first(tmp_path, name, expected):
    with pytest.raises(ConfigError, match=expected):
        check_target(tmp_path / name)


def test_mp4_needs_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match="needs ffmpeg, which is not installed"):
        check_target(tmp_path / "run.mp4")


def test_edge_run_draws_its_run(tmp_path):
    record(tmp_path, "--animate", tmp_path / "run.gif")
    shown = list(frames(tmp_path / "run.gif"))
    assert (shown[0] != shown[-1]).any()


def test_edge_run_draws_no_run_that_it_does_not_record(tmp_path):
    command = [
        sys.executable,
        "-m",
        "edge_runtime.run",
        "--robot-id",
        "0",
        "--no-log",
        "--animate",
        "run.gif",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "leave --no-log out" in done.stderr
    assert not Path(tmp_path / "run.gif").exists()
