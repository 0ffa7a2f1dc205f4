"""Teams, objectives and flows on which guidance is tried."""

import numpy as np
from hypothesis import strategies as st

from edge_runtime.guidance.guide import Guide, make_guide
from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
from edge_runtime.messages import RobotState, Teammate, TeamState
from edge_runtime.motion.point import PointForce
from edge_runtime.objectives import (
    Clustering,
    Objective,
    SafetyMargin,
    Slope,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)
from edge_runtime.policy.flow_steps import flow_steps

DYNAMICS = PointForce(mass_kg=1.0, drag=0.25, dt_s=0.1, substeps=2)


OBJECTIVES = [
    SpeedLimit(limit_m_s=0.3, weight=1.0),
    SafetyMargin(distance_m=0.5, weight=0.5),
    SafetyMargin(distance_m=0.8, look_ahead=6, weight=2.0),
    SpeedLimit(limit_m_s=0.1, look_ahead=4, weight=0.3),
]


WISHES = [
    SpatialOrder(order=(2, 0, 3, 1), gap_m=0.2, weight=0.7),
    Spacing(distance_m=0.3, weight=0.4),
    Clustering(radius_m=0.2, weight=2.0),
]


def guide_for(objectives, dynamics=DYNAMICS, **settings) -> Guide:
    """Objectives made ready for a robot, with these guidance settings."""
    return make_guide(ObjectiveSet(tuple(objectives), GuidanceSettings(**settings)), dynamics)


def random_team(draw, teammates=3, ids=None, model=DYNAMICS) -> TeamState:
    """What the first of ``ids`` knows, 0, 1, 2 and so on where None."""
    ids = ids or range(teammates + 1)

    def state(robot):
        position, velocity = draw.uniform(-0.5, 0.5, model.dims), draw.uniform(-0.4, 0.4, model.dims)
        turn = draw.uniform(-3.0, 3.0, 2).tolist() if model.turns else ()
        return RobotState(robot, 0.0, tuple(position.tolist()), tuple(velocity.tolist()), *turn)

    def intended():
        return tuple(draw.uniform(-1, 1, model.action_dim).tolist())

    mates = [Teammate(state(mate), intended()) for mate in ids[1:]]
    return TeamState(state(ids[0]), tuple(mates))


def gaussian_flow(std, mean, steps, sampler="euler"):
    """The exact flow from N(0, I) to N(mean, std^2 I): a linear field, no network at all.

    With a zero network the prior field alone transports to N(0, std^2 I); shifting the action by
    tau * mean and the velocity by mean moves its target.
    """

    taken = flow_steps(sampler, steps, std)

    class ShiftedPrior:
        sampler, schedule = None, taken
        backend, batch, action_dim, observation_dim = "closed form", 1, 2, 1

        def observe(self, observation):
            pass

        def step(self, k, action):
            tau = self.schedule[k].tau
            gain = (tau * std**2 - (1 - tau)) / ((1 - tau) ** 2 + tau**2 * std**2)
            velocity = gain * (np.asarray(action) - tau * mean) + mean
            return np.concatenate([velocity[None], gain * np.eye(2)[:, None, :]])

        def velocity(self, k, action):
            return self.step(k, action)[0]

    return ShiftedPrior()


class Stepwise:
    """A policy whose steps are taken one by one, with objectives and projections in Python."""

    sampler = None

    def __init__(self, policy):
        self._policy = policy

    def __getattr__(self, name):
        return getattr(self._policy, name)


class Quadratic(Objective, frozen=True, kw_only=True, tag="quadratic"):
    """J = 1/2 |p' - goal|^2 with a unit preview: a quadratic of the action itself."""

    goal: tuple[float, float]

    def evaluate(self, motion, outlook):
        dx, dy = motion.x - self.goal[0], motion.y - self.goal[1]
        return Slope(0.5 * (dx * dx + dy * dy), dx, dy)


UNIT = PointForce(mass_kg=1.0, drag=0.0, dt_s=1.0)  # from rest, p' = p + u


numbers = st.floats(-10, 10).filter(lambda x: x == 0 or abs(x) > 1e-3)
planar_vector = st.tuples(numbers, numbers)


@st.composite
def problems(draw, most=8):
    count = draw(st.integers(1, most))
    gradients = draw(st.lists(planar_vector, min_size=count, max_size=count))
    factors = draw(st.lists(st.floats(0.01, 100), min_size=count, max_size=count))
    return gradients, factors, draw(planar_vector)
