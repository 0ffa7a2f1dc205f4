"""The latency benchmark on a case small enough for a test: same results, rows, budgets, page."""

import json

import numpy as np
import pytest
from msgspec.structs import replace
from networks import ENGINES, needs_kernel

from benchmarks import __main__ as entry
from benchmarks.common.result_file import read_result, write_result
from benchmarks.latency import budgets, limit, machine, native, paced, samplers
from benchmarks.latency import latency_command as command
from benchmarks.latency.budgets import Budget, judge, load_budgets
from benchmarks.latency.cases import DEFAULT, Case, workload
from benchmarks.latency.contenders import CONTENDERS, prepare
from benchmarks.latency.growth import grow, paper_terms
from benchmarks.latency.latency_page import Footprint, Result, render, render_samplers
from benchmarks.latency.measure import Slot, Timing, interleave, stolen_share
from benchmarks.latency.rows import LatencyRow, compare, make_row
from benchmarks.latency.sweeps import Sweep
from edge_runtime.errors import ConfigError, PolicyError

TINY = Case(layers=(16, 16), observation_dim=5, steps=3)
ROW_KEYS = {
    "backend", "layers", "observation_dim", "action_dim", "T", "M", "K", "batch", "paced_hz",
    "median_us", "best_us", "p99_us", "p99_9_us", "ratio_to_eager",
}  # fmt: skip


def timing(*rounds):
    slots = [Slot(np.array(ticks, float), np.array(ticks, float)) for ticks in rounds]
    return Timing(tuple(slots))


@needs_kernel
@pytest.mark.parametrize(
    "case",
    [
        Case(layers=(16, 16), observation_dim=5, steps=3, neighbours=0),
        Case(layers=(16,), steps=4, batch=3, objectives=3, neighbours=2),
    ],
)
def test_every_contender_computes_the_same(case):
    pytest.importorskip("torch")
    prepare(workload(case), [name for name in CONTENDERS if name != "torch-compile"])


@needs_kernel
def test_samplers_and_modes_are_timed_beside_the_research_codes_steps():
    pytest.importorskip("torch")
    few = replace(TINY, sampler="exponential", mode="correction", steps=2)
    rows, timings = samplers.measure(2, 0.002, [TINY, few])
    backends = [*samplers.BACKENDS, "limit"]
    assert [row.backend for row in rows] == ["eager", *backends, *backends]
    assert [(row.sampler, row.T, row.mode) for row in rows[3:5]] == [
        ("euler", 3, "hierarchical"),
        ("exponential", 2, "correction"),
    ]
    assert limit.operations(few) < limit.operations(replace(few, mode="terminal"))
    assert all(row.ratio_to_eager > 0.0 for row in rows)
    *_, compiled, least = render_samplers(rows).splitlines()
    assert compiled.startswith("| compiled | exponential | 2 | correction |")
    over_the_limit = rows[-1].ratio_to_eager / rows[-2].ratio_to_eager
    assert float(compiled.split("|")[-2]) == pytest.approx(over_the_limit, abs=6e-3)
    assert least.endswith("| 1.00 |")
    assert isinstance(machine.noise(timings), list)
    assert samplers.cases()[0] == DEFAULT


def test_a_contender_that_computes_something_else_is_refused(monkeypatch):
    monkeypatch.setitem(CONTENDERS, "wrong", lambda _work: lambda: np.ones((1, 2)))
    with pytest.raises(PolicyError, match="wrong computes other actions than numpy"):
        prepare(workload(TINY), ["numpy", "wrong"])


@pytest.fixture
def quiet(monkeypatch):
    """Whatever runs beside the tests, the machine counts as quiet."""
    monkeypatch.setattr(command.machine, "noise", lambda _timings: [])


@needs_kernel
@pytest.mark.usefixtures("quiet")
def test_a_short_run_writes_its_rows_and_says_what_each_budget_is_held_by(tmp_path, capsys):
    held = [Budget("numpy", "compiled", 1e-6), Budget("compiled", "limit", 1e-6)]
    rows, code = command.run_short(held, TINY, rounds=2, slot_s=0.005)
    assert code == 0
    assert capsys.readouterr().out.count("held by") == 2
    assert [row.backend for row in rows] == ["numpy", "compiled", "limit"]
    write_result(tmp_path / "rows.json", rows)
    assert read_result(tmp_path / "rows.json", list[LatencyRow]) == rows
    assert all(set(row) >= ROW_KEYS for row in json.loads((tmp_path / "rows.json").read_text()))
    assert all(row.best_us <= row.p99_us <= row.p99_9_us for row in rows)
    lines = compare(rows, rows)
    assert len(lines) == 3
    assert all("+0.0%" in line for line in lines)


@pytest.mark.usefixtures("quiet")
def test_a_broken_budget_fails_the_run(capsys):
    _, code = command.run_short([Budget("numpy", "limit", 1e6)], TINY, rounds=2, slot_s=0.005)
    assert code == 1
    assert "BROKEN by 100%" in capsys.readouterr().out


def test_a_busy_machine_proves_nothing(monkeypatch, capsys):
    measured = []
    monkeypatch.setattr(command.machine, "noise", lambda timings: measured.append(timings) or ["busy"])
    _, code = command.run_short([Budget("numpy", "limit", 1e6)], TINY, rounds=2, slot_s=0.005)
    assert (code, len(measured)) == (3, command.ATTEMPTS)
    assert "INVALID, the machine is not quiet: " in capsys.readouterr().out


def test_a_ratio_is_the_median_over_rounds_of_the_rounds_medians():
    # A slow round slows both; one wild tick in a round moves nothing.
    slow, fast = timing([10, 10, 900], [40, 40, 40], [10, 10, 10]), timing([2, 2, 2], [8, 8, 8], [2, 2, 77])
    assert fast.times_faster_than(slow) == 5.0
    assert (fast.best_us, slow.best_us) == (2.0, 10.0)
    (verdict,) = judge([Budget("fast", "slow", 4.0)], {"fast": fast, "slow": slow})
    assert verdict.held
    assert "5 times, at least 4 asked, held by 25%" in str(verdict)


def test_other_processes_count_as_noise_and_not_against_the_longer_tick():
    slot = Slot(np.array([10.0, 30.0]), np.array([10.0, 10.0]))
    assert stolen_share({"a": Timing((slot,))}) == 0.5
    assert Timing((slot,)).times_faster_than(Timing((slot,))) == 1.0
    assert machine.noise({"peak": Timing((slot,))}) == ["other processes took 50% of the time, 3% allowed"]


def test_a_changing_clock_is_noise():
    (reason,) = machine.noise({"peak": timing([10.0], [15.0])})
    assert "speed changed 1.50 times" in reason
    assert machine.noise({"peak": timing([10.0], [11.0])}) == []


def test_budgets_name_contenders_and_only_ratios():
    known = {*CONTENDERS, "limit"}
    loaded = load_budgets()
    assert {budget.backend for budget in loaded} == {"numpy", "compiled-own", "compiled"}
    assert all(budget.backend in known and budget.against in known for budget in loaded)


def test_a_budget_for_an_untimed_contender_names_the_timed_ones():
    with pytest.raises(ConfigError, match="'fast' was not timed, only slow"):
        judge([Budget("fast", "slow", 1.0)], {"slow": timing([1.0])})


def test_a_wrong_budget_file_is_named(tmp_path):
    path = tmp_path / "budgets.toml"
    path.write_text('[[budgets]]\nbackend = "numpy"\nagainst = "eager"\nat_most = 3.0\n')
    with pytest.raises(ConfigError, match=r"budgets\.toml"):
        budgets.load_budgets(path)


def test_rounds_are_complete_and_interleaved():
    calls = []
    names = {name: (lambda name=name: calls.append(name)) for name in "abc"}
    timings = interleave(names, rounds=4, slot_s=0.001)
    assert {name: len(t.slots) for name, t in timings.items()} == {"a": 4, "b": 4, "c": 4}
    blocks = [name for i, name in enumerate(calls) if i == 0 or calls[i - 1] != name]
    assert len(blocks) >= 9  # at most one neighbour repeats between rounds


def test_operations_and_traffic_of_a_network_counted_by_hand():
    case = Case(layers=(4, 3), observation_dim=5, action_dim=2, steps=7, batch=1)
    first, inner, last = 2 * 2 * 4, 2 * 3 * (4 * 3), 2 * 3 * (3 * 2)
    assert limit.operations(case) == 2 * 5 * 4 + 7 * (first + inner + last)
    assert limit.weight_bytes(case) == 4 * (5 * 4 + 7 * (4 * 2 + 4 * 3 + 3 * 2))


@pytest.mark.parametrize("way", [(False, False), (False, True)])
def test_a_paced_variant_runs_in_a_process_of_its_own(way):
    row = paced.measure(paced.Variant("numpy", 200.0, *way, 0.3, TINY))
    assert (row.paced_hz, row.realtime, row.early_wake) == (200.0, *way)
    assert 0.0 < row.best_us <= row.p99_9_us


def test_a_refused_variant_says_why():
    assert "KeyError" in paced.measure(paced.Variant("nobody", 200.0, False, False, 0.1, TINY))


def test_growth_lists_a_sweep_beside_the_papers_terms():
    sweep = Sweep("neighbours K", "K", (1, 2, 4), lambda k: Case(neighbours=k))
    rows = [make_row("numpy", sweep.make(k), timing([10.0 * k])) for k in sweep.values]
    (growth,) = grow(sweep, rows, ["numpy"])
    assert growth.microseconds == (10.0, 20.0, 40.0)
    assert (growth.per_unit_us, growth.exponent) == pytest.approx((10.0, 1.0))
    assert paper_terms(Case(steps=10, objectives=2, neighbours=3)) == 10 * (2 * 3 + 2**2)


def test_the_page_marks_a_noisy_run_invalid():
    row = make_row("numpy", DEFAULT, timing([1.0]))
    default = [row] + [make_row(name, DEFAULT, timing([1.0])) for name in ("eager", "compiled", "limit")]
    sweep = Sweep("T", "T", (1, 2), lambda t: Case(steps=t))
    growths = grow(sweep, [make_row("numpy", sweep.make(t), timing([2.0 * t])) for t in (1, 2)], ["numpy"])

    def page(noise, estimate="443 µs"):
        return render(
            Result(
                machine=machine.describe("avx2", wakes=3), noise=noise, default=default, verdicts=[],
                small=[row], sampled=[row], kernel=["batch of 8"], growths=[growths], paced=[row],
                refusals=["refused: no right"], estimate=estimate,
                footprints=[Footprint("numpy", 33.0, 120.0)],
            )
        )  # fmt: skip

    quiet, noisy = page([]), page(["other processes took 50% of the time"])
    assert "the run is valid" in quiet
    assert "INVALID" in noisy
    assert "other processes took 50%" in noisy
    assert "Estimate for one core of a Jetson" in quiet
    assert "Jetson" not in page([], estimate="")  # on one of them there is nothing to estimate
    for fact in ("processor: ", "governor", "wake-up latency", "refused: no right", "exponent 1.00"):
        assert fact in quiet


def test_an_unreadable_older_run_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.json"):
        command.main(["--compare", str(tmp_path / "none.json")])


def test_an_unknown_measurement_lists_the_known(monkeypatch, capsys):
    monkeypatch.setattr(entry.sys, "argv", ["benchmarks", "speed"])
    assert entry.main() == 2
    assert "latency" in capsys.readouterr().err


def test_the_engines_are_described():
    assert command._engine() == (ENGINES[0] if ENGINES else "")


@needs_kernel
def test_what_the_kernel_takes_over_is_told_in_lines():
    told, timings = native.measure(rounds=1, slot_s=1e-3)
    assert len(told) == 3 + len(native.BATCHES)
    assert told[0].startswith("Sampling's fence, cluster, margin and speed: ")
    assert all(" times" in line for line in told)
    assert isinstance(machine.noise(timings), list)
