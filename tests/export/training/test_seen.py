"""What a policy saw: ranges from rolling it out, or from a file, in its manifest."""

import numpy as np
import pytest
from bundles import write_straight_bundle

from edge_runtime.errors import ConfigError
from edge_runtime.policy.bundle import load_bundle, packaged_bundle
from export.edge_export import main as edge_export
from export.training.seen import read_calibration, roll_out, with_seen

TASKS = ("balance", "navigation", "sampling")


@pytest.mark.parametrize("task", TASKS)
def test_packaged_policies_say_what_they_saw(task):
    """Short roll-outs from other seeds see hardly anything else."""
    bundle = packaged_bundle(task)
    seen = np.array([pair for field in bundle.manifest.observation for pair in field.seen])
    low, high = roll_out(bundle, teams=20, episodes=1, seed=5)
    slack = 0.1 * (seen[:, 1] - seen[:, 0])
    assert (low >= seen[:, 0] - slack).all()
    assert (high <= seen[:, 1] + slack).all()


def test_a_calibration_file_gives_the_extremes(tmp_path):
    values = np.random.default_rng(0).normal(size=(50, 18)).astype(np.float32)
    np.savez(tmp_path / "seen.npz", observation=values)
    bundle = write_straight_bundle(tmp_path / "straight")
    assert edge_export(["--seen", str(bundle), "--calibration", str(tmp_path / "seen.npz")]) == 0
    before, now = load_bundle(write_straight_bundle(tmp_path / "again")), load_bundle(bundle)
    pairs = [pair for field in now.manifest.observation for pair in field.seen]
    np.testing.assert_array_equal(np.array(pairs).T, [values.min(0), values.max(0)])
    assert now.stands_for(before.sha256)
    assert with_seen(before.manifest, np.array(pairs).T).observation == now.manifest.observation


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (b"no archive", "must hold an array"),
        ({"other": np.zeros((4, 18))}, "must hold an array"),
        ({"observation": np.zeros((4, 17))}, r"got the shape \(4, 17\)"),
        ({"observation": np.zeros(18)}, r"got the shape \(18,\)"),
        ({"observation": np.zeros((0, 18))}, r"got the shape \(0, 18\)"),
        ({"observation": np.full((4, 18), np.nan)}, "not finite"),
        ({"observation": np.array([object()] * 18)[None]}, "must hold an array"),
        (None, "cannot be read"),
    ],
)
def test_files_that_are_none_are_refused_in_one_line(tmp_path, content, wanted):
    path = tmp_path / "seen.npz"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        np.savez(path, **content)
    with pytest.raises(ConfigError, match=wanted) as error:
        read_calibration(path, 18)
    assert str(error.value).startswith(f"--calibration {path}")
    assert len(str(error.value).splitlines()) == 1


def test_a_policy_that_was_not_trained_here_needs_a_file(tmp_path, capsys):
    bundle = write_straight_bundle(tmp_path / "straight")
    assert edge_export(["--seen", str(bundle)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "was not trained here; give what it saw with --calibration FILE.npz" in line
