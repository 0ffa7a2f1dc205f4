"""Previews against literal integration, and periods against composition."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from literal_dynamics import drive

from edge_runtime.motion.dynamics import Dynamics

dynamics = st.builds(
    Dynamics,
    mass_kg=st.floats(0.2, 20),
    drag=st.floats(0, 0.9),
    dt_s=st.floats(0.005, 0.2),
    substeps=st.integers(1, 5),
)
numbers = st.floats(-3, 3)


@given(dynamics, st.integers(1, 12), numbers, numbers)
def test_preview_equals_integration(model, steps, speed, action):
    preview = model.preview(steps)
    position, velocity = drive(0.0, speed, action, model, steps)
    assert preview.position_decay * speed + preview.position_gain * action == pytest.approx(
        position, abs=1e-9
    )
    assert preview.velocity_decay * speed + preview.velocity_gain * action == pytest.approx(
        velocity, abs=1e-9
    )


@given(dynamics)
def test_shorter_periods_lose_the_same_velocity(model):
    tenth = model.at_period(model.dt_s / 10)
    assert tenth.preview(10).velocity_decay == pytest.approx(model.preview(1).velocity_decay)


def test_without_drag_it_is_the_papers_dynamics():
    preview = Dynamics(mass_kg=1.0, drag=0.0, dt_s=0.1).preview(1)
    assert (preview.velocity_decay, preview.velocity_gain) == (1.0, 0.1)
    assert preview.position_decay == pytest.approx(0.1)
    assert preview.position_gain == pytest.approx(0.01)


def test_a_preview_looks_ahead():
    with pytest.raises(ValueError, match="at least one step"):
        Dynamics(mass_kg=1.0, drag=0.0, dt_s=0.1).preview(0)
