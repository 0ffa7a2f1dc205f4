"""Motion models of every kind, and states that fit them."""

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
