"""What the policy has not seen: counted, named, and after a while a reason to stop."""

import json

import numpy as np
import pytest
from bundles import MANIFEST, write_straight_bundle
from hypothesis import given
from hypothesis import strategies as st
from logs import record, ticks
from msgspec.structs import replace

from edge_runtime.errors import BundleError
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.observation import Position, Ranges, Velocity
from edge_runtime.observation.familiarity import Familiarity, Unfamiliar
from edge_runtime.policy.schema import check_manifest
from edge_runtime.run.edge_run import main as edge_run
from edge_runtime.run.flags import make_mission, make_parser
from edge_runtime.tools.replay.edge_replay import main as edge_replay

FIELDS = (
    Position("position", 2, "m", ((-1.0, 1.0), (-1.0, 1.0))),
    Velocity("velocity", 2, "m/s"),
    Ranges("ranges", 3, "m", ((0.0, 0.35),) * 3),
)
number = st.floats(-3.0, 3.0, width=32)


@given(st.lists(number, min_size=7, max_size=7))
def test_the_worst_field_is_the_one_furthest_outside_in_widths_of_its_range(values):
    bounds = [(-1.0, 1.0)] * 2 + [(-np.inf, np.inf)] * 2 + [(0.0, np.float32(0.35))] * 3
    names = ["position"] * 2 + ["velocity"] * 2 + ["ranges"] * 3
    outside = {}
    for name, value, (low, high) in zip(names, values, bounds, strict=True):
        excess = max(value - high, low - value) / (high - low)
        if excess > 0.0:
            outside[name] = max(outside.get(name, 0.0), excess)
    found = Familiarity(FIELDS).strangest(np.array(values, np.float32))
    if not outside:
        assert found == ""
    else:
        assert outside[found] == pytest.approx(max(outside.values()), rel=1e-5)


def test_what_is_not_finite_is_no_error_here():
    for value in (np.nan, np.inf, -np.inf):
        Familiarity(FIELDS).strangest(np.full(7, value, np.float32))


def test_time_counts_while_no_tick_is_inside():
    familiarity = Familiarity(FIELDS)
    found = [familiarity.follow(f, 10.0 + at) for at, f in enumerate(["ranges", "ranges", "", "ranges"])]
    assert found == [
        Unfamiliar("ranges", 0.0),
        Unfamiliar("ranges", 1.0),
        Unfamiliar(),
        Unfamiliar("ranges", 0.0),
    ]


@pytest.mark.parametrize(
    ("seen", "wanted"),
    [
        (((0.0, 1.0),), r"observation\[0\]\.seen is 1, must be 2 pairs"),
        (((0.0, 1.0), (1.0, 0.0)), r"observation\[0\]\.seen\[1\]\[1\] is 0\.0, must be between 1"),
        (((0.0, 1.0), (float("nan"), 1.0)), r"observation\[0\]\.seen\[1\]\[0\] is nan"),
        (((0.0, float("inf")), (0.0, 1.0)), r"observation\[0\]\.seen\[0\]\[1\] is inf"),
    ],
)
def test_ranges_that_are_none_are_refused(seen, wanted):
    first, *others = MANIFEST.observation
    manifest = replace(MANIFEST, observation=(replace(first, seen=seen), *others))
    with pytest.raises(BundleError, match=wanted):
        check_manifest(manifest, "manifest.json")


def narrow_team(folder, longest=""):
    """A fleet whose policy was trained nowhere east of x = -0.7, and starts robot 0 west of that."""
    first, *others = MANIFEST.observation
    first = replace(first, seen=((-5.0, -0.7), (-5.0, 5.0)))
    write_straight_bundle(folder / "narrow", replace(MANIFEST, observation=(first, *others)))
    path = folder / "team.toml"
    path.write_text(
        f'[team]\npolicy = "./narrow"\n{longest}\n[guidance]\nstart_noise = 0.3\n'
        "[[robots]]\nid = 0\nstart_m = [-0.9, 0.0]\ngoal_m = [0.8, 0.0]\n"
    )
    return path


def test_a_robot_stops_when_it_acted_long_enough_on_what_training_never_had(tmp_path, capsys):
    fleet = narrow_team(tmp_path, "max_unfamiliar_s = 0.0")
    text = fleet.read_text().replace("-0.9", "-0.6")
    fleet.write_text(text)
    (log,) = record(tmp_path, "--fleet", str(fleet), "--json", str(tmp_path / "run.json"))
    report = json.loads((tmp_path / "run.json").read_text())
    assert report["unfamiliar"] == {"position": report["ticks"]}
    reason = "position has been outside of all that the policy saw in training for 0 s"
    assert report["faults"] == {reason: report["ticks"]}
    assert {tick.command.action for tick in ticks(log)} == {(0.0, 0.0)}
    assert "unfamiliar  60 of 60 observations: position 60" in capsys.readouterr().out
    assert edge_replay([str(log)]) == 0
    assert "unfamiliar  60 of 60 observations: position 60" in capsys.readouterr().out


def test_for_a_while_it_drives_on(tmp_path):
    fleet = narrow_team(tmp_path, "max_unfamiliar_s = 0.3")
    controller = make_mission(
        make_parser().parse_args(["--robot-id", "0", "--fleet", str(fleet)])
    ).controller(0)
    places = [-0.9, -0.6, -0.6, -0.6, -0.6, -0.9, -0.6]
    views = [TeamState(RobotState(0, 0.1 * at, (x, 0.0), (0.0, 0.0))) for at, x in enumerate(places)]
    stops = [bool(controller.decide(view, view.own.stamp_s).stop_reason) for view in views]
    assert stops == [False, False, False, False, True, False, False]


def test_without_a_limit_it_only_counts(tmp_path):
    fleet = narrow_team(tmp_path)
    (log,) = record(tmp_path, "--fleet", str(fleet), "--json", str(tmp_path / "run.json"))
    assert not any(tick.command.stop_reason for tick in ticks(log))
    counted = sum(bool(tick.observation.unfamiliar) for tick in ticks(log))
    assert json.loads((tmp_path / "run.json").read_text())["unfamiliar"].get("position", 0) == counted


def test_a_limit_without_ranges_is_refused(tmp_path, capsys):
    write_straight_bundle(tmp_path / "plain", MANIFEST)
    path = narrow_team(tmp_path, "max_unfamiliar_s = 1.0")
    path.write_text(path.read_text().replace("./narrow", "./plain"))
    assert edge_run(["--robot-id", "0", "--fleet", str(path), "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "team.max_unfamiliar_s" in line
    assert "--calibration" in line
