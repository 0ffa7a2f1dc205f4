"""Sources of the user's own: run on the user's word alone, checked in every tick, stopped at by name."""

import math
import sys
from dataclasses import replace as with_fields

import pytest
from bundles import MANIFEST, write_straight_bundle
from msgspec.structs import replace

from edge_runtime.config.fleet import DEFAULT_FLEET, load_fleet
from edge_runtime.config.own_sources import load_own_sources
from edge_runtime.control.mission import Mission
from edge_runtime.control.monitor import Monitor
from edge_runtime.errors import ConfigError
from edge_runtime.messages import RobotState, TeamState
from edge_runtime.observation import OwnSource, Position, Source
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.bundle import load_bundle

GAUGE = """
from edge_runtime.observation import Source

class Gauge(Source, frozen=True, kw_only=True):
    full: float = 1.0

    def read(self, view):
        return (self.full * view.elapsed_s, view.team.own.position_m[0])
"""
FIELD = OwnSource("battery", 2, "1", code="gauge:Gauge", parameters={"full": 2.0})
VIEW = TeamState(RobotState(0, 0.0, (0.5, 0.0), (0.0, 0.0)))


@pytest.fixture(autouse=True)
def _nothing_stays():
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]


@pytest.fixture
def fleet(tmp_path):
    """Make a fleet file that allows the sources of its folder's module."""

    def write(module=GAUGE, name="gauge:Gauge"):
        (tmp_path / "gauge.py").write_text(module)
        text = DEFAULT_FLEET.read_text().replace("[team]", f"[team]\nown_sources = ['{name}']")
        (tmp_path / "team.toml").write_text(text)
        return load_fleet(tmp_path / "team.toml")

    return write


def observer(own, field=FIELD):
    return Observer(replace(MANIFEST, observation=(Position("p", 2, "m"), field)), (0.0, 0.0), own=own)


def refusal(function, *arguments):
    with pytest.raises(ConfigError) as caught:
        function(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_source_that_the_fleet_file_names(fleet):
    gauge = observer(load_own_sources(fleet(), ()))
    assert gauge.observe(VIEW, elapsed_s=1.5)[0].tolist() == [0.5, 0.0, 3.0, 0.5]
    assert not gauge.fault


def test_a_source_that_a_flag_names(tmp_path, monkeypatch):
    (tmp_path / "gauge.py").write_text(GAUGE)
    monkeypatch.chdir(tmp_path)
    assert observer(load_own_sources(None, ["gauge:Gauge"])).observe(VIEW)[0].tolist()[2:] == [0.0, 0.5]


def test_no_bundle_makes_other_code_run(tmp_path, monkeypatch):
    (tmp_path / "gauge.py").write_text("raise SystemExit('was run')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    said = refusal(observer, ())
    assert said.startswith(
        "manifest.json: observation[1].code: 'gauge:Gauge' is code that no bundle can make run"
    )
    assert "allowed: none; name it as own_sources in the fleet file's [team], or with --own-source" in said


MISTAKES = [
    ("raise ValueError('no')", "gauge:Gauge", "cannot import 'gauge:Gauge' (ValueError: no)"),
    (GAUGE, "gauge", "'gauge' is not of the form module:Class"),
    (GAUGE, "gauge:Source", "'gauge:Source' must define read(view)"),
    (
        "class Gauge: pass",
        "gauge:Gauge",
        "'gauge:Gauge' is not a subclass of edge_runtime.observation.Source",
    ),
]


@pytest.mark.parametrize(("module", "name", "complaint"), MISTAKES)
def test_what_is_no_source(fleet, tmp_path, module, name, complaint):
    said = refusal(load_own_sources, fleet(module, name), ())
    assert said == f"{tmp_path / 'team.toml'}: team.own_sources[0]: {complaint}"


PARAMETERS = [
    ({"empty": 1.0}, "observation[1].empty: unknown key; allowed: name, size, unit, seen, full"),
    ({"full": "yes"}, "observation[1].full: Expected `float`, got `str`"),
]


@pytest.mark.parametrize(("parameters", "complaint"), PARAMETERS)
def test_parameters_that_its_class_does_not_take(fleet, parameters, complaint):
    own = load_own_sources(fleet(), ())
    assert refusal(observer, own, replace(FIELD, parameters=parameters)) == f"manifest.json: {complaint}"


FAULTS = [
    ("return 1 / 0", "its source raised ZeroDivisionError: division by zero"),
    ("raise SystemExit(0)", "its source raised SystemExit: 0"),
    ("return [math.nan] + 11 * [0.0]", "its source returned what is not finite"),
    ("return 11 * [0.0] + [math.inf]", "its source returned what is not finite"),
    ("return [1.0]", "its source returned 1 numbers, not 12"),
    ("return 12 * 'a'", "its source raised ValueError: could not convert string to float: 'a'"),
    ("return None", "its source raised TypeError: 'NoneType' object is not iterable"),
]
FAILING = """
import math
from edge_runtime.observation import Source

class Gauge(Source, frozen=True):
    def read(self, view):
        if view.elapsed_s: BODY
        return 12 * [0.0]
"""


@pytest.mark.parametrize(("body", "fault"), FAULTS)
def test_a_source_that_fails_stops_the_robot_in_the_same_tick_counted_by_name(fleet, tmp_path, body, fault):
    file, bundle = fleet(FAILING.replace("BODY", body)), load_bundle(write_straight_bundle(tmp_path / "own"))
    fields = (*bundle.manifest.observation[:3], OwnSource("battery", 12, "1", code="gauge:Gauge"))
    bundle = with_fields(bundle, manifest=replace(bundle.manifest, observation=fields))
    own = load_own_sources(file, ())
    mission = Mission(0, file, bundle, file.objective_set, 10.0, own_sources=own)
    controller, monitor = mission.controller(0), Monitor(mission.fleet, 1, 10, file.objective_set)

    def tick(stamp_s):
        team = replace(VIEW, own=replace(VIEW.own, stamp_s=stamp_s))
        guided = controller.act(controller.observe(team), team)
        command = controller.limit(guided, team, stamp_s)
        monitor.update(team, guided, command, controller.unfamiliar)
        return command

    assert tick(1.0).action != (0.0, 0.0)
    stopped = tick(1.1)
    assert (stopped.action, stopped.velocity_m_s) == ((0.0, 0.0), (0.0, 0.0))
    assert stopped.stop_reason == f"observation battery: {fault}"
    assert monitor.faults == {stopped.stop_reason: 1}


def test_a_source_of_ones_own_is_a_record_of_its_parameters():
    class Distance(Source, frozen=True, kw_only=True, tag="distance"):
        reach_m: float

        def read(self, view):
            return (min(self.reach_m, math.hypot(*view.team.own.position_m)),)

    field = OwnSource("far", 1, "m", code=f"{__name__}:{Distance.__qualname__}", parameters={"reach_m": 0.25})
    assert observer((Distance,), field).observe(VIEW)[0, 2] == 0.25
