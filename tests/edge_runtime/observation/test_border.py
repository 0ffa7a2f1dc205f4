"""Places beyond the training's arena: observed on its border, yet unfamiliar, and replayed bit for bit."""

import numpy as np
import pytest
from bundles import MANIFEST, write_straight_bundle
from hypothesis import given
from hypothesis import strategies as st
from logs import record, ticks
from msgspec.structs import replace
from networks import needs_kernel

from edge_runtime.config.fleet import DEFAULT_FLEET
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.observation import Position, Velocity
from edge_runtime.observation.border import Arena, Border
from edge_runtime.run.edge_run import main as edge_run
from edge_runtime.run.flags import make_mission, make_parser
from edge_runtime.tools.replay.edge_replay import main as edge_replay

FIELDS = (Velocity("velocity", 2, "m/s"), Position("position", 2, "m"), Velocity("again", 2, "m/s"))
UNIT = Arena((-1.0, -1.0), (1.0, 1.0))
UNIT_KEY = "training_arena = { low_m = [-1.0, -1.0], high_m = [1.0, 1.0] }"
number = st.floats(-9.0, 9.0, width=32) | st.sampled_from([np.nan, np.inf, -np.inf])
corner = st.floats(-4.0, 4.0)


def fleet_file(folder, keys, text=None):
    path = folder / "team.toml"
    path.write_text((text or DEFAULT_FLEET.read_text()).replace("[team]", f"[team]\n{keys}"))
    return path


@given(
    rows=st.lists(st.lists(number, min_size=6, max_size=6), min_size=1, max_size=4),
    low=st.tuples(corner, corner),
    wide=st.tuples(st.floats(0.1, 4.0), st.floats(0.1, 4.0)),
    scale_m=st.floats(0.2, 5.0),
)
def test_a_place_goes_to_the_nearest_inside_and_all_else_stays(rows, low, wide, scale_m):
    high = np.add(low, wide)
    seen = np.array(rows, np.float32)
    before = seen.copy()
    Border(FIELDS, Arena(low, tuple(high.tolist())), scale_m).clamp(seen)
    nearest = np.clip(before[:, 2:4].astype(float), np.divide(low, scale_m), high / scale_m)
    np.testing.assert_allclose(seen[:, 2:4], nearest, rtol=1e-6, atol=1e-6)
    others = [0, 1, 4, 5]
    assert seen[:, others].tobytes() == before[:, others].tobytes()


def test_without_an_arena_or_a_place_nothing_is_limited():
    seen = np.full((1, 4), 7.0, np.float32)
    for fields, arena in ((FIELDS[:2], None), ((FIELDS[0], FIELDS[2]), UNIT)):
        border = Border(fields, arena)
        border.clamp(seen)
        assert not border.limits
        assert (seen == 7.0).all()


@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=needs_kernel)])
def test_a_run_observes_places_on_the_border_and_is_repeated_bit_for_bit(backend, tmp_path, capsys):
    keys = "scale_m = 2.0\ntraining_arena = { low_m = [-1.0, -0.5], high_m = [1.5, 0.5] }"
    fleet = fleet_file(tmp_path, keys)
    (log,) = record(tmp_path, "--backend", backend, "--fleet", str(fleet))
    places = np.array([tick.state.own.position_m for tick in ticks(log)])
    seen = np.array([tick.observation.values[:2] for tick in ticks(log)])
    assert (places[:, 1] < -0.5).any()
    np.testing.assert_allclose(seen, np.clip(places, [-1.0, -0.5], [1.5, 0.5]) / 2.0, atol=1e-6)
    assert edge_replay([str(log)]) == 0
    assert f"identical   {len(ticks(log))} ticks, bit for bit" in capsys.readouterr().out


def test_a_place_on_the_border_decides_as_one_beyond_it(tmp_path):
    """But for the place nothing differs: no goal is observed nearer, no teammate."""
    fleet = fleet_file(tmp_path, UNIT_KEY)
    mission = make_mission(make_parser().parse_args(["--robot-id", "0", "--fleet", str(fleet)]))
    near, far = (
        mission.controller(0).observe(TeamState(RobotState(0, 0.0, (x, 0.5), (0.1, 0.0)))).copy()
        for x in (1.0, 3.0)
    )
    moved = np.flatnonzero(near[0] != far[0])
    assert moved.tolist() == [4]  # x of the way to the goal, as far as it is
    assert far[0, 4] - near[0, 4] == pytest.approx(2.0)


def test_a_place_beyond_is_unfamiliar_all_the_same(tmp_path, capsys):
    first, *others = MANIFEST.observation
    narrow = (replace(first, seen=((-5.0, -0.7), (-5.0, 5.0))), *others)
    write_straight_bundle(tmp_path / "narrow", replace(MANIFEST, observation=narrow))
    text = "[team]\n[[robots]]\nid = 0\nstart_m = [-0.6, 0.0]\ngoal_m = [0.8, 0.0]\n"
    arena = "training_arena = { low_m = [-5.0, -5.0], high_m = [-0.7, 5.0] }"
    keys = f'policy = "./narrow"\nmax_unfamiliar_s = 0.1\n{arena}'
    (log,) = record(tmp_path, "--fleet", str(fleet_file(tmp_path, keys, text)))
    driven = ticks(log)
    assert {tick.observation.values[0] for tick in driven} == {float(np.float32(-0.7))}
    assert {tick.observation.unfamiliar for tick in driven} == {"position"}
    assert driven[-1].command.stop_reason.startswith("position has been outside")
    capsys.readouterr()
    assert edge_replay([str(log)]) == 0
    assert "unfamiliar  60 of 60 observations: position 60" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arena", "wanted"),
    [
        (
            "{ low_m = [0, 0, 0], high_m = [1, 1, 1] }",
            "team.training_arena.low_m: has 3 components; allowed with policy 'navigation': 2",
        ),
        (
            "{ low_m = [0, 0], high_m = [1, 1, 1] }",
            "`high_m` must have as many components as `low_m`",
        ),
        ("{ low_m = [1, 0], high_m = [-1, 1] }", "`high_m` must be greater than `low_m` on each axis"),
        ("{ low_m = [0, 0], high_m = [1e9, 1] }", "`high_m` must lie in [-1e+06, 1e+06], got 1e+09"),
        ("{ low_m = [nan, 0], high_m = [1, 1] }", "training_arena.low_m[0]: must be a finite number"),
        ("{ low_m = [0, 0] }", "team.training_arena.high_m: missing; allowed: low_m, high_m"),
        ("1.0", "team.training_arena: Expected `object | null`, got `float`"),
    ],
)
def test_an_arena_that_is_none_is_refused_in_one_line(arena, wanted, tmp_path, capsys):
    fleet = fleet_file(tmp_path, f"training_arena = {arena}")
    assert edge_run(["--robot-id", "0", "--fleet", str(fleet), "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert wanted in line


def test_an_arena_for_a_policy_that_is_not_told_its_place_is_refused(tmp_path, capsys):
    blind = replace(MANIFEST, observation=(Velocity("once_more", 2, "m/s"), *MANIFEST.observation[1:]))
    write_straight_bundle(tmp_path / "blind", blind)
    text = "[team]\n[[robots]]\nid = 0\nstart_m = [-0.6, 0.0]\ngoal_m = [0.8, 0.0]\n"
    keys = f'policy = "./blind"\n{UNIT_KEY}'
    fleet = fleet_file(tmp_path, keys, text)
    assert edge_run(["--robot-id", "0", "--fleet", str(fleet), "--no-log"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "team.training_arena: policy 'straight' does not observe where it is; leave it out" in line
