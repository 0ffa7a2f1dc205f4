"""Plants by their protocol, what a fleet asks of one that has it not, and the three tasks by edge-run."""

import json

import numpy as np
import pytest
from clocks import simulated_time

from edge_runtime.config.fleet import FLEETS, TASKS, load_fleet
from edge_runtime.doctor.edge_doctor import main as edge_doctor
from edge_runtime.messages import Command, TeamState
from edge_runtime.run.edge_run import main as edge_run
from edge_runtime.run.flags import make_mission, make_parser
from edge_runtime.tools.report.edge_report import main as edge_report
from export.scenarios import SCENARIOS
from firmware_bridge.simulation.bridge import SimFlags, open_bridge
from firmware_bridge.simulation.plants import PLANTS, open_plant

OF_TASK = {"navigation": "discs", "balance": "vmas", "sampling": "vmas"}


def mission(path, *flags):
    return make_mission(make_parser().parse_args(["--robot-id", "0", "--fleet", str(path), *flags]))


def write(folder, task, *changes):
    text = (FLEETS / f"{task}.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "team.toml"
    path.write_text(text)
    return path


def drive(run, plant, ticks):
    """What robot 0 was commanded and where everything ended."""
    actions, controller = [], run.controller(0)
    with open_bridge(run, SimFlags(plant)) as bridge:
        for _ in range(ticks):
            own = bridge.read()
            view = TeamState(
                own,
                bridge.teammates(),
                ranges_m=bridge.ranges_m(),
                tracked=bridge.tracked(),
                readings=bridge.readings(),
            )
            command = controller.decide(view, own.stamp_s)
            assert not command.stop_reason
            actions.append(command.action)
            bridge.write(command)
        ends = [motion.position_m for motion in (*bridge.plant.motions(), *bridge.plant.objects())]
    return np.array(actions), np.array(ends), bridge


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_plants_keep_the_protocol(tmp_path, task, scale):
    path = write(tmp_path, task, ("[team]", f"[team]\nscale_m = {scale}"))
    run = mission(path)
    plant = open_plant(run)
    robots, fleet = plant.motions(), run.fleet
    np.testing.assert_allclose([m.position_m for m in robots], [r.start_m for r in fleet.robots], atol=1e-6)
    np.testing.assert_allclose(
        [m.position_m for m in plant.objects()], [e.start_m for e in fleet.tracked], atol=1e-6
    )
    assert plant.radius_m == pytest.approx(scale * SCENARIOS[task].facts.body.radius_m)
    before = [*robots, *plant.objects()]
    plant.drive([Command(robot.id, 0, 0.0, (0.5, 0.25), (0.0, 0.0)) for robot in fleet.robots])
    assert [*plant.motions(), *plant.objects()] != before
    for name in plant.sensors:
        assert np.isfinite(plant.reading(0, name)).all()
    plant.reset()
    assert [*plant.motions(), *plant.objects()] == before
    assert not plant.touched


def test_navigation_is_the_same_in_both_plants(tmp_path):
    """The built-in plant computes what VMAS does."""
    path = write(tmp_path, "navigation")
    ways = [drive(mission(path, "--backend", "numpy"), plant, 60)[:2] for plant in ("discs", "vmas")]
    for discs, vmas in zip(*ways, strict=True):
        np.testing.assert_allclose(discs, vmas, atol=2e-3)


@pytest.mark.parametrize("task", TASKS)
def test_every_task_drives_and_is_reported(tmp_path, task):
    with simulated_time():
        json_file, logs = tmp_path / "run.json", ("--log-dir", str(tmp_path))
        line = ["--robot-id", "0", "--task", task, "--duration", "2", "--json", str(json_file), *logs]
        code = edge_run(line)
    assert code == 0
    report = json.loads((tmp_path / "run.json").read_text())
    assert (report["policy"], report["faults"]) == (task, {})
    assert report["unfamiliar"] is not None
    assert set(report["objects"]) == ({"package"} if task == "balance" else set())
    (log,) = tmp_path.glob("*.mcap")
    assert edge_report([str(log), "-o", str(tmp_path / "run.html")]) == 0
    page = (tmp_path / "run.html").read_text()
    assert ("package" in page) == (task == "balance")


REFUSED = {
    "balance": [
        (
            (),
            ("--plant", "discs"),
            "tracked[0].goal_m: nothing moves 'package' in plant 'discs'; allowed: --plant",
        ),
        ((('name = "line"', 'name = "rope"'),), (), "'line'"),
        (
            (("goal_m = [0.3, 0.6]", ""), ("goal_reach = 2.0", "")),
            (),
            "tracked[0].goal_m: missing: the policy observes it",
        ),
        ((), ("--rate", "20"), "--rate 20: VMAS steps at 10 Hz"),
    ],
    "sampling": [
        ((), ("--plant", "discs"), "plant 'discs' has no 'nearby_samples'"),
        ((('scenario = "sampling"', 'scenario = "navigation"'),), (), "robots: 3; navigation has 4"),
        ((('scenario = "sampling"', 'scenario = "chess"'),), (), "scenario: is 'chess'; allowed: balance"),
        ((('scenario = "sampling"', ""),), (), "simulation.scenario: missing; allowed: balance, navigation"),
        ((('plant = "vmas" ', 'plant = "moon" '),), (), "simulation.plant:"),
        ((("seed = 3 ", "sede = 3 "),), (), "simulation.sede: unknown key; allowed: plant, scenario, seed"),
        ((("seed = 3 ", "seed = -1 "),), (), "simulation: `seed` must lie in"),
    ],
    "navigation": [
        ((("goal_m = [0.7, 0.8]", ""),), (), "robots[0].goal_m: missing: policy 'navigation' observes"),
    ],
}


@pytest.mark.parametrize(
    ("task", "changes", "flags", "wanted"),
    [(task, *case) for task, cases in REFUSED.items() for case in cases],
)
def test_what_does_not_hold_together_is_refused_in_one_line(tmp_path, capsys, task, changes, flags, wanted):
    path = write(tmp_path, task, *changes)
    assert edge_run(["--robot-id", "0", "--fleet", str(path), "--no-log", *flags]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert wanted in line


def test_a_task_and_a_fleet_are_not_both_named(capsys):
    assert edge_run(["--robot-id", "0", "--task", "balance", "--fleet", "team.toml"]) == 2
    assert "not allowed with argument" in capsys.readouterr().err


def test_a_robots_small_install_is_told_what_a_plant_needs(monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert edge_run(["--robot-id", "0", "--task", "balance", "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "needs a workstation's vmas; run: pip install 'cfpg-edge[train]'" in line


def test_every_task_has_a_fleet_and_every_plant_a_module():
    assert {task: load_fleet(FLEETS / f"{task}.toml").simulation.plant for task in TASKS} == OF_TASK
    assert set(OF_TASK.values()) <= set(PLANTS)


def test_the_doctor_looks_at_the_task_that_is_named(capsys):
    assert edge_doctor(["--whole-fleet", "--task", "sampling"]) == 0
    told = capsys.readouterr().out
    assert [f"robot {robot}" in told for robot in range(4)] == [True, True, True, False]
