import errno
import os

import pytest
import torch

from edge_runtime.errors import ConfigError
from export.algorithms.networks import FlowNetwork
from export.training.checkpoint import LARGEST_FILE, PolicyFacts, load, load_policy, save, save_policy
from export.training.run_file import write_run_file

FACTS = PolicyFacts("navigation", "mafpo", 3, 12_800, "unknown", 0.5, euler_steps=10)


def test_policy_comes_back_as_it_was_saved(tmp_path):
    network = FlowNetwork(18, 2, hidden=(8, 12), activation="tanh", prior_std=None)
    save_policy(tmp_path, network, FACTS)
    loaded, facts = load_policy(tmp_path)
    sample = torch.randn(5, 2), torch.rand(5, 1), torch.randn(5, 18)
    assert facts == FACTS
    assert torch.equal(loaded(*sample), network(*sample))


@pytest.mark.parametrize("keep", [0, 10, 1000])
def test_truncated_file_is_refused_by_name(tmp_path, keep):
    save_policy(tmp_path, FlowNetwork(18, 2), FACTS)
    path = tmp_path / "best.pt"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ConfigError, match=r"best\.pt is damaged"):
        load_policy(tmp_path)


def test_missing_run_and_foreign_checkpoint_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="does not exist"):
        load_policy(tmp_path)
    save(tmp_path / "best.pt", {"weights": torch.zeros(3)})
    with pytest.raises(ConfigError, match="no policy of this version"):
        load_policy(tmp_path)


def test_a_pipe_holds_nobody_up(tmp_path):
    os.mkfifo(tmp_path / "best.pt")
    with pytest.raises(ConfigError, match=r"best\.pt: cannot be read \(not a regular file\)"):
        load_policy(tmp_path)


def test_a_file_of_any_size_is_read_only_up_to_a_bound(tmp_path):
    (tmp_path / "best.pt").touch()
    os.truncate(tmp_path / "best.pt", LARGEST_FILE + 1)
    with pytest.raises(ConfigError, match=rf"cannot be read \(.*, at most {LARGEST_FILE} are read\)"):
        load_policy(tmp_path)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ([], "is damaged or not a checkpoint"),
        (None, "is damaged or not a checkpoint"),
        (torch.ones(2), "is damaged or not a checkpoint"),
        ({}, "holds no policy of this version"),
        ({"facts": []}, "holds no policy of this version"),
        ({"facts": {"seed": "a"}}, "holds no policy of this version"),
    ],
)
def test_a_file_of_something_else_is_refused_by_name(tmp_path, content, told):
    torch.save(content, tmp_path / "best.pt")
    with pytest.raises(ConfigError, match=rf"best\.pt {told}"):
        load_policy(tmp_path)


def test_pickled_code_is_not_executed(tmp_path):
    class Malicious:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "executed"),)

    torch.save({"facts": Malicious()}, tmp_path / "best.pt")
    with pytest.raises(ConfigError):
        load(tmp_path / "best.pt")
    assert not (tmp_path / "executed").exists()


def test_full_disk_keeps_the_old_file_and_says_so(tmp_path, monkeypatch):
    path = tmp_path / "checkpoint.pt"
    write_run_file(path, b"old")

    def no_space(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(ConfigError, match="No space left on device"):
        write_run_file(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
