import errno
import os
import zipfile
from math import inf, nan

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


def first(state, name):
    return state["actor"][name].view(-1)[:1]


FORGED = {
    "a number for a text": lambda state: state["facts"].update(scenario=3),
    "an unknown task": lambda state: state["facts"].update(scenario="juggling"),
    "a text that no line holds": lambda state: state["facts"].update(algorithm="a\nb"),
    "frames that nobody counts": lambda state: state["facts"].update(frames=-1),
    "a score that is no number": lambda state: state["facts"].update(score=nan),
    "no steps": lambda state: state["facts"].update(euler_steps=0),
    "half a step": lambda state: state["facts"].update(euler_steps=0.5),
    "a negative size": lambda state: state["network"].update(hidden=(-64, 64)),
    "no layers": lambda state: state["network"].update(hidden=()),
    "layers that no machine holds": lambda state: state["network"].update(hidden=(10**9, 10**9)),
    "layers that no robot takes": lambda state: state["network"].update(hidden=(4096,) * 16),
    "another activation": lambda state: state["network"].update(activation="relu"),
    "no spread": lambda state: state["network"].update(prior_std=0.0),
    "a list for a tensor": lambda state: state["actor"].update(phase=[0.0] * 8),
    "doubles": lambda state: state["actor"].update(phase=state["actor"]["phase"].double()),
    "complex numbers": lambda state: state["actor"].update(phase=state["actor"]["phase"].cfloat()),
    "a sparse tensor": lambda state: state["actor"].update(phase=state["actor"]["phase"].to_sparse()),
    "tensors of tensors": lambda state: state["actor"].update(
        phase=torch.nested.nested_tensor([state["actor"]["phase"]])
    ),
    "a tensor of nothing": lambda state: state["actor"].update(phase=state["actor"]["phase"].to("meta")),
    "a column for a row": lambda state: state["actor"].update(phase=state["actor"]["phase"][:, None]),
    "a number repeated without end": lambda state: state["actor"].update(phase=torch.ones(1).expand(10**12)),
    "not a number": lambda state: first(state, "from_observation.bias").fill_(nan),
    "infinity": lambda state: first(state, "from_observation.bias").fill_(inf),
    "weights beyond all measure": lambda state: state["actor"]["from_observation.weight"].fill_(1e30),
    "weights that overflow together": lambda state: [
        value.fill_(1e12) for name, value in state["actor"].items() if name.endswith("weight")
    ],
    "less variance than none": lambda state: first(state, "moments.variance").fill_(-1.0),
}


@pytest.mark.filterwarnings("ignore:The PyTorch API of nested tensors")
@pytest.mark.parametrize("forge", FORGED)
def test_a_sound_file_of_forged_values_is_refused_by_name(tmp_path, forge):
    save_policy(tmp_path, FlowNetwork(18, 2), FACTS)
    state = load(tmp_path / "best.pt")
    FORGED[forge](state)
    torch.save(state, tmp_path / "best.pt")
    with pytest.raises(ConfigError, match=r"best\.pt holds no policy of this version: train again"):
        load_policy(tmp_path)


def rewritten(path, pickled=None, compression=zipfile.ZIP_STORED):
    """Write a file of torch's anew, as others could: another tree in it, or compressed."""
    with zipfile.ZipFile(path) as archive:
        members = {each.filename: archive.read(each) for each in archive.infolist()}
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, pickled if pickled and name.endswith("data.pkl") else content)


def test_a_tree_without_a_bottom_is_refused_by_name(tmp_path):
    save_policy(tmp_path, FlowNetwork(18, 2), FACTS)
    depth = 1_000_000
    rewritten(tmp_path / "best.pt", b"\x80\x02}X\x05\0\0\0facts" + b"]" * depth + b"a" * (depth - 1) + b"s.")
    with pytest.raises(ConfigError, match=r"best\.pt holds no policy of this version"):
        load_policy(tmp_path)


def test_what_unpacks_to_more_than_the_file_is_refused_by_name(tmp_path):
    save_policy(tmp_path, FlowNetwork(18, 2), FACTS)
    rewritten(tmp_path / "best.pt")
    assert load_policy(tmp_path)[1] == FACTS
    rewritten(tmp_path / "best.pt", compression=zipfile.ZIP_DEFLATED)
    with pytest.raises(ConfigError, match=r"best\.pt is damaged or not a checkpoint"):
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
