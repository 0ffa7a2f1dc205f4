"""ROS is loaded from the folders that the user names, and from nowhere else."""

import sys

import pytest

from edge_runtime.errors import BridgeError
from firmware_bridge.ros.installed import load


@pytest.fixture(autouse=True)
def _path(monkeypatch):
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delenv("PYTHONPATH", raising=False)
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]


@pytest.fixture
def ros(tmp_path):
    (tmp_path / "fakeros.py").write_text("place = __file__\n")
    (tmp_path / "msgspec.py").write_text("raise AssertionError('ours goes first')\n")
    return str(tmp_path)


def test_a_named_folder_is_searched_after_our_own(ros):
    before = list(sys.path)
    fakeros, msgspec = load(("fakeros", "msgspec"), (ros, ros))
    assert fakeros.place.startswith(ros)
    assert not msgspec.__file__.startswith(ros)
    assert sys.path == [*before, ros]


def test_what_the_shell_names_is_not(ros, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{ros}:")
    monkeypatch.setattr(sys, "path", [ros, *sys.path])
    with pytest.raises(BridgeError, match="fakeros is not installed: this Python's packages do not have it"):
        load(("fakeros",), ())
    (fakeros,) = load(("fakeros",), (ros,))
    assert fakeros.place.startswith(ros)


def test_the_line_names_folders_and_remedy(tmp_path):
    with pytest.raises(BridgeError) as caught:
        load(("fakeros",), (str(tmp_path), "/nowhere"))
    assert str(caught.value) == (
        f"fakeros is not installed: neither this Python's packages nor {tmp_path}, /nowhere have it; "
        "install ROS, or pass --ros-path DIR"
    )


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import nothing_of_the_kind", "No module named 'nothing_of_the_kind'"),
        ("raise OSError('librcl.so:\\n not found')", "librcl.so:"),
    ],
)
def test_what_does_not_load_is_told_in_one_line(tmp_path, code, said):
    (tmp_path / "fakeros.py").write_text(code)
    with pytest.raises(BridgeError) as caught:
        load(("fakeros",), (str(tmp_path),))
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert str(caught.value) == (
        f"fakeros does not load ({said}): source your ROS's setup.bash first, with Python {python}, "
        "and check --ros-path"
    )
