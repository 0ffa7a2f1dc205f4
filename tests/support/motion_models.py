"""Motion models of every kind, and states that fit them."""

import numpy as np
from hypothesis import strategies as st

from edge_runtime.messages import RobotState
from edge_runtime.motion.models import LinearTable, PointAcceleration, PointForce, Unicycle, VelocityLag

_share = st.floats(0.0, 0.9)
_period = st.floats(0.005, 0.2)
_substeps = st.integers(1, 5)
_dims = st.sampled_from([2, 3])
_gain = st.floats(0.2, 5.0)

forces = st.builds(
    PointForce,
    mass_kg=st.floats(0.2, 20.0),
    drag=_share,
    dt_s=_period,
    substeps=_substeps,
    dims=_dims,
    inertia_kg_m2=st.none() | st.floats(0.05, 5.0),
).flatmap(
    lambda model: st.just(model) if not model.turns else st.builds(lambda d: _with(model, yaw_drag=d), _share)
)
accelerations = st.builds(
    PointAcceleration,
    dt_s=_period,
    drag=_share,
    substeps=_substeps,
    dims=_dims,
    angular=st.booleans(),
    gain=_gain,
)
_lag = st.just(0.0) | st.floats(0.02, 2.0)
velocities = st.builds(
    VelocityLag, dt_s=_period, time_constant_s=_lag, dims=_dims, angular=st.booleans(), gain=_gain
)
unicycles = st.builds(
    Unicycle,
    dt_s=_period,
    forward=st.sampled_from(["speed", "acceleration"]),
    turn=st.sampled_from(["rate", "acceleration"]),
    gain=_gain,
)


def _with(model, **fields):
    return type(model)(**{name: getattr(model, name) for name in model.__struct_fields__} | fields)


@st.composite
def tables(draw, most=8):
    dims, d, turns = draw(_dims), draw(st.integers(1, most)), draw(st.booleans())
    entry = st.floats(-2.0, 2.0)
    row = st.tuples(*[entry] * d)
    rows = st.tuples(*[row] * dims)
    turn = (
        {
            "yaw_rate_decay": draw(st.floats(0.0, 1.0)),
            "yaw_rate_gain": draw(row),
            "heading_decay": draw(st.floats(0.0, 0.2)),
            "heading_gain": draw(row),
        }
        if turns
        else {}
    )
    return LinearTable(
        dt_s=draw(_period),
        velocity_decay=draw(st.tuples(*[st.floats(0.0, 1.0)] * dims)),
        velocity_gain=draw(rows),
        position_decay=draw(st.tuples(*[st.floats(0.0, 0.2)] * dims)),
        position_gain=draw(rows),
        dims=dims,
        **turn,
    )


models = st.one_of(forces, accelerations, velocities, unicycles, tables())


@st.composite
def moving(draw, kinds=models):
    """A model, a state that fits it, and an action."""
    model = draw(kinds)
    number = st.floats(-3.0, 3.0)
    vector = st.tuples(*[number] * model.dims)
    turn = (draw(number), draw(number)) if model.turns else (0.0, 0.0)
    state = RobotState(0, 0.0, draw(vector), draw(vector), *turn)
    return model, state, draw(st.tuples(*[number] * model.action_dim))


def _table(d, dims, turns, seed=0):
    draw = np.random.default_rng([seed, d])

    def rows(*shape):
        values = 0.06 * draw.standard_normal(shape)
        return tuple(map(tuple, values.tolist())) if len(shape) == 2 else tuple(values.tolist())

    turn = {"yaw_rate_gain": rows(d), "heading_gain": rows(d)} if turns else {}
    decays = {"velocity_decay": (0.7,) * dims, "position_decay": (0.08,) * dims}
    return LinearTable(
        0.1, velocity_gain=rows(dims, d), position_gain=rows(dims, d), dims=dims, **decays, **turn
    )


EXAMPLES = {
    "line": _table(1, 2, False),
    "force": PointForce(1.0, 0.25, 0.1, 2),
    "velocity": VelocityLag(0.1, time_constant_s=0.3),
    "unicycle": Unicycle(0.1),
    "pushed unicycle": Unicycle(0.1, forward="acceleration", turn="acceleration"),
    "skewed table": _table(2, 2, True),
    "paper": PointAcceleration(0.1, angular=True),
    "drone": PointAcceleration(0.1, drag=0.1, dims=3),
    "holonomic": VelocityLag(0.1, time_constant_s=0.2, angular=True, yaw_time_constant_s=0.1),
    "turning drone": PointForce(2.0, 0.1, 0.1, 2, dims=3, inertia_kg_m2=0.5, yaw_drag=0.2),
    "table of five": _table(5, 3, True),
    "table of six": _table(6, 3, True),
}
"""Robots of one to six action components, in the plane and in space."""
