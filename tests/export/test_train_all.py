"""Training every policy of the tables: which commands, in which order, and what a failure leaves."""

from threading import Event, Thread

import pytest
from msgspec.structs import asdict

from edge_runtime.errors import ConfigError
from export import train_all
from export.algorithms.mafpo_warm import MafpoWarm
from export.edge_train import parse
from export.schedule import pool
from export.schedule.job import FRAMES, jobs, run
from export.train_all import main
from export.training import request as training_request
from export.training.checkpoint import RunIdentity, save
from export.training.lock import locked, wait_until_free
from export.training.request import ALGORITHMS, check_request


def job(out, algorithm, scenario="balance", seed=2):
    (found,) = (j for j in jobs(out, [scenario], [algorithm], seed + 1) if j.seed == seed)
    return found


def begun(job):
    job.directory.mkdir(parents=True)
    (job.directory / "checkpoint.pt").touch()
    return job


def told(job, frames, seconds):
    """Has the job's run tell how fast it is."""
    job.directory.mkdir(parents=True, exist_ok=True)
    (job.directory / "metrics.csv").write_text(f"frames,seconds\n{frames},{seconds}\n")


def train_request(job):
    """What edge-train makes of the job's command; the other command exports it."""
    (module, *flags), export = job.commands()
    assert module == "export.edge_train"
    assert export == ["export.edge_export", str(job.directory), "--out", str(job.bundle)]
    return parse(flags)[0]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("scenario", FRAMES)
def test_edge_train_takes_the_commands_of_every_job(tmp_path, scenario, algorithm, monkeypatch):
    monkeypatch.setattr(training_request, "load_warm_start", lambda run, _scenario: run)
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

    monkeypatch.setattr(pool, "run", run)
    return events


def assert_each_begins_after_its_predecessor(events):
    warm = [seed for event, algorithm, seed in events if (event, algorithm) == ("begun", "mafpo-warm")]
    assert sorted(warm) == [0, 1]
    for seed in warm:
        begun = events.index(("begun", "mafpo-warm", seed))
        assert events.index(("finished", "mappo", seed)) < begun


@pytest.mark.parametrize("at_once", ["1", "3"])
def test_a_warm_job_waits_for_the_one_that_it_begins_with(tmp_path, monkeypatch, at_once):
    events = events_of(monkeypatch)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--seeds", "2", "--jobs", at_once]
    assert main([*flags, "--algorithms", "mafpo-warm", "mappo", "mafpo-chain"]) == 0
    assert len(events) == 12
    assert_each_begins_after_its_predecessor(events)


def test_workers_of_a_dask_cluster_train_in_this_process_stead(tmp_path, monkeypatch, capsys):
    distributed = pytest.importorskip("distributed")
    events = events_of(monkeypatch)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--seeds", "2"]
    told(job(tmp_path, "mappo"), 1000, 1.0)
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    )
    with cluster:
        flags += ["--dask", cluster.scheduler_address]
        assert main([*flags, "--algorithms", "mappo", "mafpo-warm"]) == 0
    assert_each_begins_after_its_predecessor(events)
    assert "with 2 at once" in capsys.readouterr().out


def test_no_scheduler_at_the_address_is_one_line(tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(pool, "CONNECT_S", 0.2)
    assert main(["--out", str(tmp_path), "--dask", "tcp://127.0.0.1:9"]) == 2
    assert "--dask tcp://127.0.0.1:9: no scheduler answers there" in capsys.readouterr().err


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


def test_the_cost_is_told_before_and_counts_what_is_left(tmp_path, monkeypatch, capsys):
    events_of(monkeypatch)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--algorithms", "mappo", "--jobs", "2"]
    half, speed = FRAMES["balance"] // 2, 1000
    told(job(tmp_path, "mappo", seed=0), half, half / speed)
    assert main([*flags, "--seeds", "2"]) == 0
    shown = capsys.readouterr().out
    hours = 3 * half / speed / 3600
    assert f"2 to train: {3 * half / 1e6:.1f} million frames, 4 MB, {hours:.1f} h of one core" in shown
    assert f"about {hours / 2:.1f} h with 2 at once" in shown


def test_no_time_is_told_before_a_run_of_the_task_and_algorithm_tells_it(tmp_path, monkeypatch, capsys):
    def one_by_one(open_jobs, _executor):
        for job in open_jobs:
            job.bundle.mkdir(parents=True)
            (job.bundle / "manifest.json").touch()
            told(job, job.frames, 3600.0)
            yield job, ""

    monkeypatch.setattr(train_all, "work_off", one_by_one)
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--seeds", "2"]
    assert main([*flags, "--algorithms", "mappo", "mafpo"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if "to train" in line]
    assert len(lines) == 4
    assert " MB; the time of 4 is not known yet" in lines[0]
    assert "1.0 h of one core, about 1.0 h with 1 at once; the time of 2 is not known yet" in lines[1]
    assert lines[2].endswith("2.0 h of one core, about 2.0 h with 1 at once")


def test_an_interruption_begins_nothing_more():
    begun, cancelled, ran = Event(), Event(), []

    def first():
        begun.set()
        cancelled.wait(10.0)

    def interrupted():
        with pool.pool(1, None) as (executor, _):
            executor.submit(first)
            executor.submit(ran.append, "second").add_done_callback(lambda _: cancelled.set())
            begun.wait()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert ran == []


def test_a_run_of_another_budget_is_no_policy_of_the_tables(tmp_path, capsys):
    wanted = job(tmp_path, "mappo", seed=0)
    wanted.directory.mkdir(parents=True)
    identity = RunIdentity(
        scenario="balance", algorithm="mappo", seed=0, frames=700_000, workers=1, observation_dim=16,
        action_dim=2, hidden=(64, 64),
    )  # fmt: skip
    save(wanted.directory / "checkpoint.pt", {"identity": asdict(identity)})
    flags = ["--out", str(tmp_path), "--scenarios", "balance", "--algorithms", "mappo", "--seeds", "1"]
    assert main(flags) == 2
    said = capsys.readouterr().err
    assert f"was trained for 700000 frames, not {FRAMES['balance']}: choose another --out" in said
    save(wanted.directory / "checkpoint.pt", {"frames": 700_000})
    assert main(flags) == 2
    assert "holds no run of this version" in capsys.readouterr().err


def test_what_edge_train_says_is_what_is_told(tmp_path):
    wanted = begun(job(tmp_path, "mappo"))
    with pytest.raises(ConfigError, match=r"checkpoint\.pt is damaged or not a checkpoint"):
        run(wanted)
    assert "is damaged" in (wanted.directory / "log.txt").read_text()


def test_a_directory_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "balance").touch()
    with pytest.raises(ConfigError, match="nothing can be written there"):
        run(job(tmp_path, "mappo"))


def test_a_process_left_behind_is_waited_for(tmp_path):
    freed = Event()
    with locked(tmp_path):
        waiter = Thread(target=lambda: (wait_until_free(tmp_path), freed.set()))
        waiter.start()
        assert not freed.wait(0.1)
    waiter.join()
    assert freed.is_set()
    wait_until_free(tmp_path)
