"""Every motion model against independent roll-outs, and its Jacobian against autograd."""

import functools

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from motion_models import forces, models, moving, tables
from torch_rollout import rolled_out, tensor

from edge_runtime.motion.linear import LinearPreview, PlanarPreview
from edge_runtime.motion.models import (
    LinearTable,
    MotionModel,
    PointAcceleration,
    PointForce,
    Unicycle,
    VelocityLag,
)
from edge_runtime.objectives import Slope

steps_ahead = st.integers(1, 8)


def stacked(model, state, steps, action):
    """The roll-out's components in the order of a `PredictedMotion`, (8,)."""
    (x, y, *z), (vx, vy, *vz), heading, yaw_rate = rolled_out(model, state, action, steps)
    nothing = tensor(0.0)
    turn = [heading, yaw_rate] if model.turns else [nothing, nothing]
    return torch.stack([x, y, vx, vy, *(z or [nothing]), *(vz or [nothing]), *turn])


@given(moving(), steps_ahead)
def test_a_prediction_is_the_roll_out_and_its_jacobian_autograds(case, steps):
    model, state, action = case
    roll = functools.partial(stacked, model, state, steps)
    expected = roll(tensor(action)).numpy()
    np.testing.assert_allclose(model.predict(state, action, steps), expected, rtol=1e-9, atol=1e-9)
    jacobian = torch.autograd.functional.jacobian(roll, tensor(action)).numpy()
    columns = model.jacobian(state, action, steps)
    width = len(columns[-1])
    assert all(len(column) <= width for column in columns)
    for j, column in enumerate(columns):
        found = np.array([*column, *[0.0] * (8 - len(column))])
        np.testing.assert_allclose(found, jacobian[:, j], rtol=1e-9, atol=1e-9)


@given(moving(), steps_ahead)
def test_the_jacobian_agrees_with_finite_differences(case, steps):
    model, state, action = case
    for j, column in enumerate(model.jacobian(state, action, steps)):
        ahead, behind = (
            np.array(model.predict(state, [u + h * (i == j) for i, u in enumerate(action)], steps))
            for h in (1e-5, -1e-5)
        )
        slope = (ahead - behind)[: len(column)] / 2e-5
        np.testing.assert_allclose(column, slope, rtol=1e-5, atol=1e-5)


@given(moving(), steps_ahead)
def test_several_steps_are_one_after_another(case, steps):
    model, state, action = case
    now = state
    for _ in range(steps):
        motion = model.predict(now, action)
        now = msgspec.structs.replace(
            state,
            position_m=motion.position_m(model.dims),
            velocity_m_s=motion.velocity_m_s(model.dims),
            heading_rad=motion.heading,
            yaw_rate_rad_s=motion.yaw_rate,
        )
    np.testing.assert_allclose(motion, model.predict(state, action, steps), rtol=1e-9, atol=1e-9)


@given(moving(forces | tables()), st.integers(2, 6))
def test_a_shorter_period_keeps_as_much_velocity_in_as_many_steps(case, parts):
    model, state, action = case
    rest = [0.0] * len(action)
    shorter = model.at_period(model.dt_s / parts)
    np.testing.assert_allclose(
        shorter.predict(state, rest, parts).velocity_m_s(3),
        model.predict(state, rest).velocity_m_s(3),
        rtol=1e-9,
        atol=1e-9,
    )


@given(moving(tables()), st.integers(2, 6))
def test_a_tables_periods_compose_exactly(case, parts):
    model, state, action = case
    shorter = model.at_period(model.dt_s / parts)
    longer = shorter.at_period(model.dt_s)
    for again in (longer.predict(state, action), shorter.predict(state, action, parts)):
        np.testing.assert_allclose(again, model.predict(state, action), rtol=1e-6, atol=1e-6)


@given(moving(), steps_ahead, st.floats(0.1, 10.0))
def test_a_larger_world_is_the_same_motion_in_its_own_metres(case, steps, scale):
    model, state, action = case
    large = msgspec.structs.replace(
        state,
        position_m=tuple(scale * value for value in state.position_m),
        velocity_m_s=tuple(scale * value for value in state.velocity_m_s),
    )
    found, expected = (
        one.predict(where, action, steps) for one, where in ((model.scaled(scale), large), (model, state))
    )
    np.testing.assert_allclose(found[:6], np.array(expected[:6]) * scale, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(found[6:], expected[6:], rtol=1e-9, atol=1e-9)


@given(moving(), steps_ahead)
def test_no_unit_action_moves_a_robot_farther_than_the_gains_say(case, steps):
    """Of the unicycle's these are the forward component's, which a turn can only lessen."""
    model, state, action = case
    preview = model.preview(steps)
    columns = np.array(
        [[*column, *[0.0] * (8 - len(column))] for column in model.jacobian(state, action, steps)]
    )
    for components, gain in (([0, 1, 4], preview.position_gain), ([2, 3, 5], preview.velocity_gain)):
        if isinstance(model, Unicycle):
            assert np.linalg.norm(columns[0, components]) <= gain * (1.0 + 1e-9)
        else:
            assert np.linalg.norm(columns[:, components], 2) == pytest.approx(gain, rel=1e-9)


@given(
    st.floats(0.2, 20), st.floats(0.0, 0.9), st.floats(0.005, 0.2), st.integers(1, 5), steps_ahead, st.data()
)
def test_the_planar_shortcut_computes_the_same_bits(mass, drag, dt_s, substeps, steps, data):
    """And those that previews have always had: a recorded tick is repeated bit for bit."""
    model = PointForce(mass, drag, dt_s, substeps)
    keep, gain = 1.0 - drag, dt_s / mass
    ramp = dt_s * (substeps + 1) / (2 * substeps)
    velocity_decay, velocity_gain, position_decay, position_gain = 1.0, 0.0, 0.0, 0.0
    for _ in range(steps):
        position_decay += dt_s * keep * velocity_decay
        position_gain += dt_s * keep * velocity_gain + ramp * gain
        velocity_decay *= keep
        velocity_gain = keep * velocity_gain + gain
    planar = model.preview(steps)
    assert isinstance(planar, PlanarPreview)
    assert (planar.position_gain, planar.velocity_gain) == (position_gain, velocity_gain)
    assert (planar.position_decay, planar.velocity_decay) == (position_decay, velocity_decay)
    axes = tuple(axis.after(steps) for axis in model.axes())
    general = LinearPreview(position_gain, velocity_gain, 2, False, axes, planar.columns)
    _, state, action = data.draw(moving(st.just(model)))
    assert planar.predict(state, action) == general.predict(state, action)
    (found, jacobian), (expected, other) = (one.forecast(state).at(action) for one in (planar, general))
    assert found == expected
    slope = Slope(0.0, 0.3, -0.2, 1.5, 0.7)
    assert jacobian.columns == other.columns
    assert jacobian.pull_back(slope) == other.pull_back(slope)
    assert planar.forecast(state).at(action)[0] == planar.predict(state, action)


@given(models)
def test_models_come_back_from_json_and_are_sound(model):
    assert msgspec.json.decode(msgspec.json.encode(model), type=MotionModel) == model
    faults = list(model.faults())
    assert not faults or not any(map(any, (*model.velocity_gain, *model.position_gain)))


TABLE = LinearTable(0.1, (0.5, 0.5), ((1.0, 0.0), (0.0, 1.0)), (0.1, 0.1), ((0.1, 0.0), (0.0, 0.1)))


@pytest.mark.parametrize(
    ("model", "key"),
    [
        (PointForce(0.0, 0.0, 0.1), "mass_kg"),
        (PointForce(1.0, 1.0, 0.1), "drag"),
        (PointForce(1.0, float("nan"), 0.1), "drag"),
        (PointForce(1.0, 0.0, 0.0), "dt_s"),
        (PointForce(1.0, 0.0, 0.1, 101), "substeps"),
        (PointForce(1.0, 0.0, 0.1, inertia_kg_m2=-1.0), "inertia_kg_m2"),
        (PointForce(1.0, 0.0, 0.1, yaw_drag=0.5), "yaw_drag"),
        (PointAcceleration(0.1, drag=-0.1), "drag"),
        (PointAcceleration(0.1, gain=0.0), "gain"),
        (PointAcceleration(0.1, yaw_drag=0.1), "yaw_drag"),
        (VelocityLag(-0.1), "dt_s"),
        (VelocityLag(0.1, time_constant_s=-1.0), "time_constant_s"),
        (VelocityLag(0.1, yaw_time_constant_s=1.0), "yaw_time_constant_s"),
        (Unicycle(0.1, gain=float("inf")), "gain"),
        (msgspec.structs.replace(TABLE, velocity_decay=(0.5,)), "velocity_decay"),
        (msgspec.structs.replace(TABLE, position_gain=((0.1, 0.0), (0.1,))), "position_gain[1]"),
        (msgspec.structs.replace(TABLE, velocity_gain=((), ())), "velocity_gain: number of columns"),
        (msgspec.structs.replace(TABLE, velocity_decay=(0.5, 1.5)), "velocity_decay[1]"),
        (msgspec.structs.replace(TABLE, yaw_rate_gain=(1.0, 1.0)), "heading_gain"),
        (msgspec.structs.replace(TABLE, heading_decay=-1.0), "heading_decay"),
        (
            msgspec.structs.replace(TABLE, velocity_gain=((0.0,), (0.0,)), position_gain=((0.0,), (0.0,))),
            "position_gain",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else value.kind,
)
def test_numbers_that_do_not_hold_together_are_named(model, key):
    assert key in [found for found, _, _ in model.faults()]


@given(moving())
def test_a_prediction_looks_ahead(case):
    model, state, action = case
    with pytest.raises(ValueError, match="at least one step ahead, got 0"):
        model.predict(state, action, 0)


@given(moving())
def test_an_action_of_the_wrong_length_is_refused(case):
    model, state, action = case
    for wrong in ([*action, 0.0], action[:-1]):
        with pytest.raises(ValueError, match=r"argument|unpack"):
            model.predict(state, wrong)


def test_without_drag_it_is_the_papers_dynamics():
    axis, _, turn = PointAcceleration(0.1, angular=True).axes()
    assert (axis.velocity_decay, axis.velocity_gain) == (1.0, (0.1, 0.0, 0.0))
    assert axis.position_decay == pytest.approx(0.1)
    assert axis.position_gain == pytest.approx((0.01, 0.0, 0.0))
    assert turn.velocity_gain == (0.0, 0.0, 0.1)
