"""Each source against what it says of itself, computed here by other means."""

import math
from typing import get_args

import msgspec
import numpy as np
import pytest
from bundles import MANIFEST
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from paths import ROOT

from edge_runtime.messages import Reading, RobotState, Teammate, TeamState, TrackedObject
from edge_runtime.motion.models import PointForce
from edge_runtime.observation import (
    SOURCES,
    Constant,
    Extent,
    GoalOffset,
    Heading,
    ObservationField,
    Position,
    PreviousAction,
    Sensor,
    Source,
    TeammateOffsets,
    TeammatesPresent,
    TeammateVelocities,
    TimeLeft,
    TrackedGoalOffset,
    TrackedHeading,
    TrackedOffset,
    TrackedVelocity,
    TrackedYawRate,
    Velocity,
    YawRate,
)
from edge_runtime.observation.observer import Observer
from edge_runtime.policy.bundle import packaged_bundle

NUMBER = st.floats(-10, 10)
ANGLE = st.floats(-7, 7)


def vectors(dims):
    return st.tuples(*[NUMBER] * dims)


@st.composite
def scenes(draw, mates=5):
    """A robot's view in the plane or in space, with a tracked object; and its goal."""
    dims = draw(st.sampled_from((2, 3)))
    vector = vectors(dims)
    states = [
        RobotState(i, 0.0, draw(vector), draw(vector), draw(ANGLE), draw(NUMBER))
        for i in range(draw(st.integers(1, 1 + mates)))
    ]
    others = [Teammate(state) for state in states[1:]]
    parted = draw(st.integers(0, len(others)))
    tracked = TrackedObject(
        "load", 0.0, draw(vector), draw(vector), draw(ANGLE), draw(NUMBER), goal_m=draw(vector)
    )
    team = TeamState(states[0], tuple(others[:parted]), silent=tuple(others[parted:]), tracked=(tracked,))
    return team, draw(vector)


def observed(team, goal_m, *fields, **inputs):
    """What the fields give, in double precision where they are tuples of the view's own numbers."""
    dims = len(team.own.position_m)
    motion = PointForce(1.0, 0.0, 0.1, dims=dims)
    spaces = replace(MANIFEST, observation=fields, motion=motion, action=MANIFEST.action[:1] * dims)
    sized = tuple(replace(field, size=field.components(spaces.extent) or field.size) for field in fields)
    observer = Observer(replace(spaces, observation=sized), goal_m)
    found = observer.observe(team, **inputs)[0].copy()
    return found, observer.fault


def turned(vector, heading_rad):
    """The vector along axes that are turned by a heading about z, by complex numbers."""
    plane = complex(*vector[:2]) * np.exp(-1j * heading_rad)
    return [plane.real, plane.imag, *vector[2:]]


@given(scenes())
def test_own_motion(scene):
    team, goal_m = scene
    own = team.own
    fields = Position("p", 0, "m"), Velocity("v", 0, "m/s"), Heading("h", 0, "1"), YawRate("w", 0, "rad/s")
    found, fault = observed(team, goal_m, *fields)
    angle = math.sin(own.heading_rad), math.cos(own.heading_rad)
    np.testing.assert_array_equal(
        found, np.float32([*own.position_m, *own.velocity_m_s, *angle, own.yaw_rate_rad_s])
    )
    assert not fault


@given(scenes())
def test_vectors_along_the_robots_own_axes(scene):
    team, goal_m = scene
    (load,), own = team.tracked, team.own
    fields = (
        Velocity("v", 0, "m/s", frame="body"),
        GoalOffset("g", 0, "m", frame="body"),
        TrackedOffset("o", 0, "m", object="load", frame="body"),
        TrackedVelocity("t", 0, "m/s", object="load", frame="body"),
        TrackedGoalOffset("l", 0, "m", object="load", frame="body"),
    )
    position, there = np.array(own.position_m), np.array(load.position_m)
    expected = [
        own.velocity_m_s,
        position - goal_m,
        position - there,
        load.velocity_m_s,
        there - load.goal_m,
    ]
    found, _ = observed(team, goal_m, *fields)
    np.testing.assert_allclose(
        found, np.concatenate([turned(v, own.heading_rad) for v in expected]), atol=1e-5
    )


@given(scenes(), st.integers(1, 4))
def test_the_nearest_teammates_come_first_and_zeros_fill_up(scene, count):
    team, goal_m = scene
    own, dims = team.own, len(team.own.position_m)
    fields = (
        TeammateOffsets("o", 0, "m", count=count),
        TeammateVelocities("v", 0, "m/s", count=count, frame="body"),
        TeammatesPresent("n", 0, "1", count=count),
    )
    found, _ = observed(team, goal_m, *fields)
    mates = [mate.state for mate in team.teammates + team.silent]
    distance = [np.linalg.norm(np.subtract(own.position_m, mate.position_m)) for mate in mates]
    order = np.lexsort([[mate.robot_id for mate in mates], distance])[:count] if mates else []
    offsets, speeds = np.zeros((count, dims)), np.zeros((count, dims))
    for row, index in enumerate(order):
        offsets[row] = np.subtract(own.position_m, mates[index].position_m)
        speeds[row] = turned(np.subtract(own.velocity_m_s, mates[index].velocity_m_s), own.heading_rad)
    present = np.arange(count) < len(mates)
    np.testing.assert_allclose(found, np.concatenate([offsets.ravel(), speeds.ravel(), present]), atol=1e-5)


@given(scenes(), st.integers(1, 4))
def test_a_tracked_objects_heading(scene, symmetry):
    team, goal_m = scene
    (load,) = team.tracked
    same = {"object": "load", "symmetry": symmetry}
    fields = [TrackedHeading(f"{only}", 0, "1", **same, only=only) for only in (None, "sine", "cosine")]
    found, _ = observed(team, goal_m, *fields, TrackedYawRate("w", 0, "rad/s", object="load"))
    angle = np.exp(1j * symmetry * load.heading_rad)
    expected = [angle.imag, angle.real, angle.imag, angle.real, load.yaw_rate_rad_s]
    np.testing.assert_allclose(found, expected, atol=1e-5)
    again, _ = observed(
        replace(team, tracked=(replace(load, heading_rad=load.heading_rad + 2 * math.pi / symmetry),)),
        goal_m,
        *fields,
    )
    np.testing.assert_allclose(again, found[:4], atol=1e-5)  # it looks the same


ALONE = TeamState(RobotState(0, 0.0, (0.0, 0.0), (0.0, 0.0)))


def test_what_the_task_says():
    fields = (
        TimeLeft("t", 0, "s", horizon_s=5.0),
        Constant("c", 0, "1", values=(0.25, 0.75)),
        PreviousAction("a", 0, "N"),
    )
    at_first, _ = observed(ALONE, (0.0, 0.0), *fields)
    np.testing.assert_array_equal(at_first, [5.0, 0.25, 0.75, 0.0, 0.0])
    later, _ = observed(ALONE, (0.0, 0.0), *fields, previous_action=(0.5, -1.0), elapsed_s=4.5)
    np.testing.assert_array_equal(later, [0.5, 0.25, 0.75, 0.5, -1.0])
    after, _ = observed(ALONE, (0.0, 0.0), *fields, elapsed_s=9.0)
    assert after[0] == 0.0


def test_a_sensor_that_the_link_provides():
    field = Sensor("gas", 2, "1", sensor="mq2")
    team = replace(ALONE, readings=(Reading("other", (9.0,)), Reading("mq2", (0.5, 1.5))))
    assert observed(team, (0.0, 0.0), field)[0].tolist() == [0.5, 1.5]


LOAD = TrackedObject("load", 0.0, (1.0, 0.0), (0.0, 0.0))
LACKING = [
    (Sensor("gas", 2, "1", sensor="mq2"), ALONE, "observation gas: sensor 'mq2' has no reading"),
    (
        Sensor("gas", 2, "1", sensor="mq2"),
        replace(ALONE, readings=(Reading("mq2", (0.5,)),)),
        "observation gas: sensor 'mq2' has 1 numbers, not 2",
    ),
    (
        TrackedOffset("to", 0, "m", object="load"),
        ALONE,
        "observation to: the pose of tracked object 'load' is not known",
    ),
    (
        TrackedOffset("to", 0, "m", object="load"),
        replace(ALONE, tracked=(replace(LOAD, position_m=(1.0, 0.0, 2.0), velocity_m_s=(0.0, 0.0, 0.0)),)),
        "observation to: it has 2 components, and what it is compared with 3",
    ),
    (
        TrackedGoalOffset("go", 0, "m", object="load"),
        replace(ALONE, tracked=(LOAD,)),
        "observation go: tracked object 'load' has no goal_m in the fleet file",
    ),
]


@pytest.mark.parametrize(("field", "team", "fault"), LACKING, ids=[fault for *_, fault in LACKING])
def test_what_is_not_there_is_nan_and_named(field, team, fault):
    found, said = observed(team, (0.0, 0.0), Position("p", 0, "m"), field)
    assert said == fault
    assert found[:2].tolist() == [0.0, 0.0]
    assert np.isnan(found[2:]).all()
    observer = Observer(replace(MANIFEST, observation=(Position("p", 2, "m"),)), (0.0, 0.0))
    observer.observe(ALONE)
    assert not observer.fault


def test_every_source_is_described_and_survives_its_own_file():
    extent = Extent(2, 2, 12)
    assert get_args(ObservationField) == SOURCES
    for kind in SOURCES:
        needed = {"horizon_s": 1.0, "values": (1.0,), "count": 2, "sensor": "s", "object": "o", "code": "a:B"}
        own = {name: value for name, value in needed.items() if name in kind.__struct_fields__}
        field = kind("name", 3, kind.unit_here or "1", **own)
        assert kind.__doc__
        assert msgspec.json.decode(msgspec.json.encode(field), type=ObservationField) == field
        assert isinstance(field, Source)
        assert field.components(extent) is None or field.components(extent) > 0


@pytest.mark.parametrize("task", ["balance", "navigation", "sampling"])
def test_the_robots_code_knows_no_tasks_fields(task):
    """What a task calls its fields stands in its bundle; sources alone stand in the code."""
    fields = packaged_bundle(task).manifest.observation
    names = {field.name for field in fields} - {kind.__struct_config__.tag for kind in SOURCES}
    code = "\n".join(path.read_text() for path in (ROOT / "edge_runtime").rglob("*.py"))
    assert not {name for name in names if name in code}
