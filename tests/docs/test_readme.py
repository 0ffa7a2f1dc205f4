"""What the README shows works as it stands."""

import re

import msgspec
from paths import ROOT

from edge_runtime.config.fleet import load_steering
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.objectives.gradient_check import GradientReport

README = (ROOT / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_objective_of_ones_own_passes_its_check(tmp_path, capsys):
    objective, check = blocks("python")
    names = {"__name__": "stay_north"}
    exec(compile(objective, "README", "exec"), names)  # noqa: S102
    exec(compile(check, "README", "exec"), names)  # noqa: S102
    assert GradientReport.__name__ in capsys.readouterr().out
    (tmp_path / "stay_north.py").write_text(objective)
    (tmp_path / "mine.toml").write_text('[[objectives]]\ntype = "stay_north:StayNorth"\nline_m = 0.1\n')
    (loaded,) = load_steering(tmp_path / "mine.toml").objectives
    assert (loaded.name, loaded.line_m) == ("stay_north", 0.1)


def test_the_objectives_file_loads(tmp_path):
    (text,) = blocks("toml")
    (tmp_path / "slow.toml").write_text(text)
    steering = load_steering(tmp_path / "slow.toml")
    assert [type(objective) for objective in steering.objectives] == [SpeedLimit, SafetyMargin]
    assert steering.guidance == type(steering.guidance)()


def test_the_table_is_the_recorded_one():
    results = ROOT / "benchmarks" / "results" / "navigation.json"
    for row in msgspec.json.decode(results.read_bytes()):
        name = row["mode"] if row["mode"] == "unguided" else f"{row['mode']}, eta {row['scale']:g}"
        mean, error = row["multi_objective_success"]
        shown = rf"\| {re.escape(name)} \| {row['start_noise']:g} \|.*\| {mean:.1f} ± {error:.1f} \|"
        assert re.search(shown, README), name
