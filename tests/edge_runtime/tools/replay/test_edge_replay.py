"""edge-replay: bit for bit on every backend, and every planted change found."""

import math
import re
import shutil
import sys

import numpy as np
import pytest
from bundle_files import edit_manifest
from logs import in_space, record, ticks, with_tick, write
from msgspec.structs import replace
from networks import needs_kernel

from edge_runtime.config.fleet import DEFAULT_FLEET
from edge_runtime.guidance.flow import guided_action
from edge_runtime.policy.bundle import PACKAGED, packaged_bundle
from edge_runtime.recording.reader import read_log
from edge_runtime.recording.schema import LoggedObjectiveSet, Start, Tick
from edge_runtime.recording.wire import LogReport
from edge_runtime.tools.replay.edge_replay import main
from edge_runtime.tools.replay.replay import Replay, recorded_objectives, recorded_policy
from edge_runtime.tools.report.animate import animate_run
from edge_runtime.tools.report.edge_report import main as report

NUMBER = 17
NAVIGATION = str(PACKAGED / "navigation")


@pytest.fixture(scope="module", params=["numpy", pytest.param("compiled", marks=needs_kernel)])
def log(request, tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("log"), "--backend", request.param)
    return path


@pytest.fixture(scope="module")
def one_log(tmp_path_factory):
    (path,) = record(tmp_path_factory.mktemp("one"), "--backend", "numpy")
    return path


def ulp(value):
    return math.nextafter(value, math.inf)


def ulp32(value):
    return float(np.nextafter(np.float32(value), np.float32(np.inf)))


def test_a_run_is_repeated_bit_for_bit(log, capsys):
    assert len({tick.inputs.start for tick in ticks(log)}) == len(ticks(log))  # noise in every tick
    assert main([str(log)]) == 0
    assert f"identical   {len(ticks(log))} ticks, bit for bit" in capsys.readouterr().out


def test_a_run_of_a_scaled_team_is_repeated(tmp_path):
    """So is that of a robot with limits of its own."""
    path = tmp_path / "team.toml"
    text = DEFAULT_FLEET.read_text().replace("[team]", "[team]\nscale_m = 1.5\nmax_action = 0.6")
    path.write_text(text)
    (scaled,) = record(tmp_path, "--fleet", str(path), "--duration", "0.5")
    assert max(abs(a) for tick in ticks(scaled) for a in tick.command.action) <= 0.6
    assert main([str(scaled)]) == 0


PLANTED = {
    "start": ("action", {"inputs": lambda inputs: replace(inputs, start=(ulp(inputs.start[0]), 0.5))}),
    "state": (
        "observation",
        {"state": lambda team: replace(team, own=replace(team.own, position_m=(ulp32(0.3), 0.2)))},
    ),
    "observation": (
        "observation",
        {"observation": lambda seen: replace(seen, values=(ulp32(seen.values[0]), *seen.values[1:]))},
    ),
    "action": (
        "action",
        {"action": lambda action: replace(action, action=(ulp(action.action[0]), action.action[1]))},
    ),
    "cost": ("action", {"action": lambda action: replace(action, costs=(5e-324, *action.costs[1:]))}),
    "command": (
        "command",
        {"command": lambda command: replace(command, velocity_m_s=(0.1, ulp(command.velocity_m_s[1])))},
    ),
}


@pytest.mark.parametrize("planted", PLANTED)
def test_one_changed_bit_is_named_with_its_tick_and_stage(log, tmp_path, capsys, planted):
    stage, change = PLANTED[planted]
    path = with_tick(log, tmp_path / "planted.mcap", NUMBER, **change)
    assert main([str(path)]) == 1
    text = capsys.readouterr().out
    assert f"differs     1 of {len(ticks(log))} ticks" in text
    assert f"tick {NUMBER}, stage {stage}: " in text


def test_objectives_that_were_not_those_are_found(log, tmp_path, capsys):
    """The speed limit raised by one ulp changes the cost wherever it is exceeded."""

    def raised(chosen):
        limit, *rest = chosen.objectives
        parameters = limit.parameters.replace('"limit_m_s":0.3', f'"limit_m_s":{ulp(0.3)!r}')
        assert parameters != limit.parameters
        return replace(chosen, objectives=(replace(limit, parameters=parameters), *rest))

    records = [raised(item) if isinstance(item, LoggedObjectiveSet) else item for item in read_log(log)]
    assert main([str(write(tmp_path / "raised.mcap", records))]) == 1
    assert "stage action: " in capsys.readouterr().out


def again(log, change):
    """Decide a log's ticks again from changed ones, as the loop would have, and return that log's records."""
    replay, records = None, []
    for item in read_log(log):
        if isinstance(item, Start):
            bundle = packaged_bundle(item.bundle.name)
            policy, _ = recorded_policy(item, bundle)
            replay = Replay(item, bundle, policy)
        elif isinstance(item, LoggedObjectiveSet):
            replay.follow(recorded_objectives(item, log))
        elif isinstance(item, Tick):
            item = change(item, replay, policy)
        records.append(item)
    return records


def test_ticks_that_their_deadline_cut_are_repeated_with_as_many_steps(log, tmp_path):
    steps, total = set(), packaged_bundle("navigation").manifest.steps

    def cut(tick, replay, policy):
        inputs = np.array([tick.observation.values], np.float32)
        most = 1 + tick.inputs.number % total
        action = guided_action(policy, inputs, tick.state, replay._guide, tick.inputs.start, most_steps=most)
        steps.add(action.steps)
        command = replay.limit(tick, action, tick.observation)
        return replace(tick, action=action, command=command)

    assert main([str(write(tmp_path / "cut.mcap", again(log, cut)))]) == 0
    assert steps == set(range(1, total + 1))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_states_that_are_not_finite_are_recorded_and_repeated(log, tmp_path, value):
    def broken(tick, replay, _policy):
        own = replace(tick.state.own, position_m=(value, 0.0), velocity_m_s=(0.0, value))
        tick = replace(tick, state=replace(tick.state, own=own))
        tick = replace(tick, observation=replay.observe(tick))
        tick = replace(tick, action=replay.act(tick, tick.observation))
        return replace(tick, command=replay.limit(tick, tick.action, tick.observation))

    path = write(tmp_path / "broken.mcap", again(log, broken))
    assert all(tick.command.stop_reason for tick in ticks(path))
    assert repr(ticks(path)[0].state.own.position_m[0]) == repr(value)
    assert main([str(path)]) == 0


GO_EAST = """
from pathlib import Path
from edge_runtime.objectives import Objective, Slope

with (Path(__file__).parent / "imported").open("a") as file:
    file.write("x")


class {name}(Objective, frozen=True, kw_only=True, tag="{module}"):
    pull: float

    def evaluate(self, motion, outlook):
        return Slope(self.pull, d_vx=-self.pull)
"""


def own_objective(tmp_path, module):
    """An objective's module, whose imports are counted, and the file that names it."""
    (tmp_path / f"{module}.py").write_text(GO_EAST.format(name="GoEast", module=module))
    (tmp_path / "east.toml").write_text(f'[[objectives]]\ntype = "{module}:GoEast"\npull = 0.1\n')
    return tmp_path / "east.toml"


@pytest.fixture
def east_log(tmp_path):
    """A log that names an own objective of this process, beside a module of the same name."""
    (path,) = record(tmp_path, "--objectives", str(own_objective(tmp_path, "go_east")))
    return path


def forget(name):
    sys.modules.pop(name)


def imports(folder):
    return len((folder / "imported").read_text())


def test_nothing_is_imported_on_a_logs_word(tmp_path, east_log, capsys, monkeypatch):
    forget("go_east")
    monkeypatch.chdir(tmp_path)
    assert main([str(east_log)]) == 2
    assert imports(tmp_path) == 1  # by the run itself
    complaint = capsys.readouterr().err
    assert complaint.startswith(
        f"edge-replay: {east_log}: followed 'go_east:GoEast', code that no log can make run"
    )
    assert "name it with --own go_east:GoEast" in complaint
    assert complaint.count("\n") == 1
    assert report(["-o", str(tmp_path / "page.html"), str(east_log)]) == 0
    animate_run(LogReport(str(east_log), 1, 60, 0, ""), tmp_path / "run.gif")
    assert imports(tmp_path) == 1


def test_an_own_objective_that_the_user_names(tmp_path, east_log, monkeypatch):
    forget("go_east")
    monkeypatch.chdir(tmp_path)
    assert main([str(east_log), "--own", "go_east:GoEast"]) == 0
    assert imports(tmp_path) == 2
    assert {tick.action.costs for tick in ticks(east_log)} == {(0.1,)}


def test_an_own_objective_that_the_users_fleet_file_names(tmp_path, east_log):
    forget("go_east")
    fleet = tmp_path / "fleet.toml"
    robots = "[[robots]]\nid = 0\nstart_m = [0, 0]\ngoal_m = [1, 0]\n"
    fleet.write_text(robots + (tmp_path / "east.toml").read_text())
    assert main([str(east_log), "--fleet", str(fleet)]) == 0


@pytest.mark.parametrize("name", ["go_west:GoWest", "go_west", "os:getcwd", "math:", ":x"])
def test_own_objectives_that_are_none(east_log, capsys, name):
    assert main([str(east_log), "--own", name]) == 2
    assert capsys.readouterr().err.startswith(f"edge-replay: --own {name}: ")


def test_how_far_preferences_reached_is_recorded_and_repeated(tmp_path, monkeypatch):
    (tmp_path / "wish_east.py").write_text(
        "from typing import ClassVar\n"
        "from edge_runtime.objectives import Objective, Slope\n"
        "class WishEast(Objective, frozen=True, kw_only=True, tag='wish_east'):\n"
        "    preference: ClassVar[bool] = True\n"
        "    def evaluate(self, motion, outlook):\n"
        "        return Slope(1.0, d_vx=-100.0)\n"
    )
    objectives = tmp_path / "east.toml"
    objectives.write_text('[[objectives]]\ntype = "wish_east:WishEast"\n[guidance]\nreach = 0.125\n')
    (path,) = record(tmp_path / "logs", "--objectives", str(objectives))
    assert {tick.action.correction for tick in ticks(path)} != {(0.0, 0.0)}
    for tick in ticks(path):
        assert math.hypot(*tick.action.correction) == pytest.approx(0.125)
    monkeypatch.chdir(tmp_path)
    assert main([str(path), "--own", "wish_east:WishEast"]) == 0


def test_in_how_many_steps_requirements_corrected_is_recorded_and_repeated(tmp_path, capsys):
    """A speed limit and a margin that nobody can keep both, so that more steps make another action."""
    objectives = tmp_path / "both.toml"
    objectives.write_text(
        '[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.1\n'
        '[[objectives]]\ntype = "safety_margin"\ndistance_m = 1.6\n'
        "[guidance]\nrequirement_steps = 3\n"
    )
    (path,) = record(tmp_path / "logs", "--objectives", str(objectives))
    assert main([str(path)]) == 0
    records = [
        replace(item, requirement_steps=1) if isinstance(item, LoggedObjectiveSet) else item
        for item in read_log(path)
    ]
    assert main([str(write(tmp_path / "fewer.mcap", records))]) == 1
    assert "stage action: action[" in capsys.readouterr().out


def test_unguided_runs_are_repeated(tmp_path):
    (path,) = record(tmp_path, "--no-guidance")
    assert {tick.action.costs for tick in ticks(path)} == {()}
    assert main([str(path)]) == 0


def test_a_cut_log_is_judged_up_to_its_damage(one_log, tmp_path, capsys):
    path = tmp_path / "cut.mcap"
    path.write_bytes(one_log.read_bytes()[:-100])
    assert main([str(path)]) == 1
    assert "damaged     its index is cut off after tick" in capsys.readouterr().out


def test_a_log_of_another_policy_is_refused_unless_that_is_the_question(one_log, tmp_path, capsys):
    start, *rest = read_log(one_log)
    moved = replace(start.bundle, sha256="0" * 64, directory=str(tmp_path / "gone"))
    path = write(tmp_path / "other.mcap", [replace(start, bundle=moved), *rest])
    assert main([str(path)]) == 2
    error = capsys.readouterr().err
    assert "SHA-256 000000000000" in error
    assert "--policy" in error
    assert main([str(path), "--policy", str(PACKAGED / "navigation")]) == 0
    assert "what if" in capsys.readouterr().out


def test_another_policy_answers_what_if_and_is_drawn(one_log, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    other = tmp_path / "other"
    shutil.copytree(PACKAGED / "navigation", other)
    edit_manifest(other, "action.0.high", 0.5)
    picture = tmp_path / "instead.png"
    assert main([str(one_log), "--policy", str(other), "-o", str(picture)]) == 0
    text = capsys.readouterr().out
    assert f"what if     {other}" in text
    assert picture.read_bytes().startswith(b"\x89PNG")
    changed = sum(tick.action.action[0] > 0.5 for tick in ticks(one_log))
    assert f"actions     {changed} of {len(ticks(one_log))} would differ" in text


def test_other_objectives_answer_what_if(one_log, tmp_path, capsys):
    slow = tmp_path / "slow.toml"
    slow.write_text('[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.02\n')
    assert main([str(one_log), "--objectives", str(slow)]) == 0
    text = capsys.readouterr().out
    fastest = max(math.hypot(*tick.command.velocity_m_s) for tick in ticks(one_log))
    assert f"speed       {fastest:.3f} m/s commanded at most" in text
    assert main([str(one_log), "--policy", str(PACKAGED / "navigation")]) == 0
    assert "identical" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["-o", "x.png"], "say with --objectives or --policy"),
        (["--policy", NAVIGATION, "-o", "/proc/none/x.png"], "-o /proc/none/x.png: cannot be written"),
        (["--policy", NAVIGATION, "-o", "x.xyz"], "-o x.xyz: a picture's name ends in .png, .pdf, .svg"),
        (["--policy", NAVIGATION, "-o", "x"], "-o x: a picture's name ends in"),
        (["--policy", "nowhere"], "no such bundle"),
        (["--what"], "unrecognized arguments"),
    ],
)
def test_bad_flags_are_one_line(one_log, capsys, flags, complaint):
    assert main([str(one_log), *flags]) == 2
    captured = capsys.readouterr()
    assert complaint in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_a_policy_for_another_body_is_refused_in_one_line(one_log, tmp_path, capsys):
    assert main([str(in_space(one_log, tmp_path / "space.mcap"))]) == 2
    assert "the log's positions have 3 components, the policy's 2" in capsys.readouterr().err

    def longer(tick):
        inputs, action, command = tick.inputs, tick.action, tick.command
        mates = tuple(replace(m, intended_action=(*m.intended_action, 0.0)) for m in tick.state.teammates)
        return replace(
            tick,
            inputs=replace(
                inputs, start=(*inputs.start, 0.0), previous_action=(*inputs.previous_action, 0.0)
            ),
            state=replace(tick.state, teammates=mates),
            action=replace(action, action=(*action.action, 0.0)),
            command=replace(command, action=(*command.action, 0.0)),
        )

    assert main([str(elsewhere(one_log, tmp_path / "longer.mcap", longer))]) == 2
    assert "the log's actions have 3 components, the policy's 2" in capsys.readouterr().err


def elsewhere(log, path, change=lambda tick: tick):
    """The log as a processor with another instruction set might have left it."""
    start, *rest = read_log(log)
    settings = replace(start.settings, backend="compiled", engine="abacus")
    ticks = [change(item) if isinstance(item, Tick) else item for item in rest]
    return write(path, [replace(start, settings=settings), *ticks])


def off(amount):
    def change(tick):
        x, *others = tick.action.action
        return replace(tick, action=replace(tick.action, action=(x + amount, *others)))

    return change


def test_a_log_of_another_processor_is_held_to_a_tolerance(one_log, tmp_path, capsys):
    assert main([str(elsewhere(one_log, tmp_path / "near.mcap", off(1e-7)))]) == 0
    assert re.search(r" within 1e-05 \([1-9]e-07 apart at most\): ", capsys.readouterr().out)
    assert main([str(elsewhere(one_log, tmp_path / "far.mcap", off(1e-4)))]) == 1
    assert "stage action: action[0] was " in capsys.readouterr().out


def test_a_question_needs_no_equal_bits(one_log, tmp_path, capsys):
    slow = tmp_path / "slow.toml"
    slow.write_text('[[objectives]]\ntype = "speed_limit"\nlimit_m_s = 0.05\n')
    assert main([str(elsewhere(one_log, tmp_path / "log.mcap")), "--objectives", str(slow)]) == 0
    assert "what if" in capsys.readouterr().out


def test_a_log_that_is_refused_hides_no_others_verdict(one_log, tmp_path, capsys):
    assert main([str(tmp_path / "none.mcap"), str(one_log)]) == 2
    captured = capsys.readouterr()
    assert "identical" in captured.out
    assert captured.err.startswith("edge-replay: ") and captured.err.count("\n") == 1
