"""Training every policy of the tables: which commands, in which order, and what a failure leaves."""

import pytest

from edge_runtime.errors import ConfigError
from export import train_all
from export.algorithms.mafpo_warm import MafpoWarm
from export.edge_train import parse
from export.train_all import FRAMES, jobs, main
from export.training.request import ALGORITHMS, check_request


def job(out, algorithm, scenario="balance", seed=2):
    (found,) = (j for j in jobs(out, [scenario], [algorithm], seed + 1) if j.seed == seed)
    return found


def begun(job):
    job.directory.mkdir(parents=True)
    (job.directory / "checkpoint.pt").touch()
    return job


def train_request(job):
    """What edge-train makes of the job's command; the other command exports it."""
    (module, *flags), export = job.commands()
    assert module == "export.edge_train"
    assert export == ["export.edge_export", str(job.directory), "--out", str(job.bundle)]
    return parse(flags)[0]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("scenario", FRAMES)
def test_edge_train_takes_the_commands_of_every_job(tmp_path, scenario, algorithm):
    wanted = job(tmp_path, algorithm, scenario)
    request = train_request(wanted)
    assert (request.scenario, request.algorithm, request.seed) == (scenario, algorithm, 2)
    assert not request.resume
    assert check_request(request, 1).settings.frames == request.frames
    assert train_request(begun(wanted)).resume


def test_a_warm_job_begins_with_the_gaussian_policy_of_its_task_and_seed(tmp_path):
    wanted = job(tmp_path, "mafpo-warm")
    request = train_request(wanted)
    assert request.warm_start == job(tmp_path, "mappo").directory == tmp_path / "balance" / "mappo" / "seed-2"
    assert request.frames == MafpoWarm.settings.frames
    assert train_request(begun(wanted)).warm_start is None
    assert train_request(job(tmp_path, "mappo")).warm_start is None


def events_of(monkeypatch, fails=lambda _job: False):
    events = []

    def run(job):
        events.append(("begun", job.algorithm, job.seed))
        if fails(job):
            raise ConfigError(f"{job.directory}: export.edge_train failed")
        events.append(("finished", job.algorithm, job.seed))
        job.bundle.mkdir(parents=True)
        (job.bundle / "manifest.json").touch()

    monkeypatch.setattr(train_all, "run", run)
    return events


@pytest.mark.parametrize("at_once", ["1", "3"])
def test_warm_jobs_wait_until_all_others_are_there(tmp_path, monkeypatch, at_once):
    events = events_of(monkeypatch)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--seeds", "2", "--jobs", at_once]
    assert main([*flags, "--algorithms", "mafpo-warm", "mappo", "mafpo-chain"]) == 0
    warm = [i for i, (_, algorithm, _) in enumerate(events) if algorithm == "mafpo-warm"]
    assert len(events) == 12
    assert warm == list(range(8, 12))


def test_what_is_finished_is_not_trained_again(tmp_path, monkeypatch, capsys):
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--algorithms", "mappo", "mafpo-warm"]
    assert len(events_of(monkeypatch)) == 0
    assert main([*flags, "--seeds", "1"]) == 0
    events = events_of(monkeypatch)
    assert main([*flags, "--seeds", "2"]) == 0
    assert {seed for _, _, seed in events} == {1}
    assert "2 of 4 policies are finished" in capsys.readouterr().out


def test_a_failure_is_one_line_and_the_others_go_on(tmp_path, monkeypatch, capsys):
    events = events_of(monkeypatch, lambda job: job.algorithm == "mappo" and job.seed == 0)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--algorithms", "mappo", "--seeds", "2"]
    assert main(flags) == 1
    assert ("finished", "mappo", 1) in events
    lines = capsys.readouterr().out.splitlines()
    assert f"train_all: {tmp_path}/balance/mappo/seed-0: export.edge_train failed" in lines
