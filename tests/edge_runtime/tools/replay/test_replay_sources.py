"""What a policy observed by its sources is observed again, bit for bit, and by no code that nobody named."""

import sys

import bundles
import numpy as np
import pytest
from bundle_files import write_bundle
from logs import record, ticks, write
from msgspec.structs import replace

from edge_runtime.doctor.edge_doctor import main as edge_doctor
from edge_runtime.observation import Heading, OwnSource, PreviousAction, TimeLeft
from edge_runtime.policy.weight_file import pack_weights
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import Tick
from edge_runtime.run.edge_run import main as edge_run
from edge_runtime.tools.replay.edge_replay import main as edge_replay

GAUGE = """
from edge_runtime.doctor.edge_doctor import main as edge_doctor
from edge_runtime.observation import Source

class Gauge(Source, frozen=True):
    def read(self, view):
        assert view.team.own.position_m[0] < FARTHEST_M, "empty"
        return [view.elapsed_s, *view.team.own.position_m, *view.previous_action, *view.goal_m]
"""
FIELDS = (
    *bundles.MANIFEST.observation[:3],
    PreviousAction("last", 2, "N"),
    TimeLeft("left", 1, "s", horizon_s=1000.0),
    Heading("heading", 2, "1"),
    OwnSource("gauge", 7, "1", code="gauge:Gauge"),
)
OWN = ("--own-source", "gauge:Gauge")


@pytest.fixture
def policy(tmp_path, monkeypatch):
    """A bundle whose policy observes so, and a module for its own source; returns the flag that names it."""
    manifest = replace(bundles.MANIFEST, observation=FIELDS)
    write_bundle(tmp_path / "mine", pack_weights(bundles.straight_weights()), manifest=manifest)
    monkeypatch.chdir(tmp_path)

    def write(farthest_m=1e9):
        (tmp_path / "gauge.py").write_text(GAUGE.replace("FARTHEST_M", str(farthest_m)))
        return "--policy", str(tmp_path / "mine")

    yield write
    sys.modules.pop("gauge", None)


def test_a_log_replays_and_so_does_a_later_part_of_it(tmp_path, policy, capsys):
    (log,) = record(tmp_path, *policy(), *OWN)
    half = [one for one in read_log(log) if not (isinstance(one, Tick) and one.inputs.number < 30)]
    later = write(tmp_path / "later.mcap", half)
    first, second = ticks(log)[:2]
    assert first.observation.values[6:9] == (0.0, 0.0, 1000.0)
    assert second.inputs.elapsed_s > first.inputs.elapsed_s == 0.0
    assert second.observation.values[8] == np.float32(1000.0 - second.inputs.elapsed_s)
    assert second.observation.values[6:8] == second.observation.values[14:16] != (0.0, 0.0)
    assert edge_replay([str(log), str(later), *OWN]) == 0
    assert capsys.readouterr().out.count("bit for bit") == 2


def test_nothing_is_imported_on_a_logs_word(tmp_path, policy, capsys):
    (log,) = record(tmp_path, *policy(), *OWN)
    sys.modules.pop("gauge")
    (tmp_path / "gauge.py").write_text("raise SystemExit('was run')")
    assert edge_replay([str(log)]) == 2
    complaint = capsys.readouterr().err
    assert "observation[6].code: 'gauge:Gauge' is code that no bundle can make run here" in complaint
    assert complaint.count("\n") == 1
    assert "gauge" not in sys.modules


def test_ticks_in_which_a_source_failed_replay_too(tmp_path, policy):
    (log,) = record(tmp_path, *policy(farthest_m=-0.79), *OWN)
    faults = [tick.command.stop_reason for tick in ticks(log)]
    assert (faults[0], faults[-1]) == ("", "observation gauge: its source raised AssertionError: empty")
    assert all(tick.command.action == (0.0, 0.0) for tick in ticks(log) if tick.command.stop_reason)
    assert edge_replay([str(log), *OWN]) == 0


REFUSALS = [
    ([], "observation[6].code: 'gauge:Gauge' is code that no bundle can make run here; allowed: none"),
    (["--own-source", "gauge"], "--own-source gauge: 'gauge' is not of the form module:Class"),
    (["--own-source", "gauge:Tank"], "--own-source gauge:Tank: cannot import 'gauge:Tank' (AttributeError: "),
]


@pytest.mark.parametrize(("flags", "complaint"), REFUSALS)
def test_a_robot_that_may_not_run_a_policys_code_does_not_begin(policy, capsys, flags, complaint):
    assert edge_run(["--robot-id", "0", "--no-log", *policy(), *flags]) == 2
    told = capsys.readouterr()
    assert complaint in told.err
    assert told.err.count("\n") == 1
    assert not told.out
    edge_doctor(["--robot-id", "0", *policy(), *flags])
    assert complaint in "".join(capsys.readouterr())
