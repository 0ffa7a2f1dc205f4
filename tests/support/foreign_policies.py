"""Four policies of somebody else's: velocity fields that plain PyTorch fits in seconds, and their facts.

Each imitates a few lines of steering by flow matching: a_tau = (1 - tau) a_0 + tau a_1, with a_0 from N(0, 1)
and a_1 from N(m, s^2) around the steering m. The field is fitted to E[a_1 - a_0 | a_tau], which is known,

    v = m + k (a_tau - tau m),   k = (tau s^2 - (1 - tau)) / ((1 - tau)^2 + tau^2 s^2).
"""

import warnings
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import nn

SPREAD, WIDTH, STEPS, BATCH, RATE = 0.2, 96, 2000, 512, 2e-2
REACH_M, CLEARANCE_M, SPEED_M_S = 2.0, 0.3, 0.35


class Policy(NamedTuple):
    facts: str
    observe: Callable  # (generator, B) -> observations (B, O) of the kind that robots meet
    steer: Callable  # (B, O) -> actions (B, d)


class Field(nn.Module):
    def __init__(self, action_dim, observation_dim):
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(action_dim + 1 + observation_dim, WIDTH),
            nn.SiLU(),
            nn.Linear(WIDTH, WIDTH),
            nn.SiLU(),
            nn.Linear(WIDTH, action_dim),
        )

    def forward(self, action, tau, observation):
        return self.layers(torch.cat([action, tau, observation], -1))


def fitted(policy, seed=0):
    """The field of a policy."""
    generator = torch.Generator().manual_seed(seed)
    torch.manual_seed(seed)
    sample = policy.observe(generator, 2)
    field = Field(policy.steer(sample).shape[1], sample.shape[1])
    optimiser = torch.optim.Adam(field.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for _ in range(STEPS):
        observation = policy.observe(generator, BATCH)
        mean, tau = policy.steer(observation), torch.rand(BATCH, 1, generator=generator)
        variance = (1 - tau).square() + (tau * SPREAD).square()
        aside = variance.sqrt() * torch.randn(mean.shape, generator=generator)
        wanted = mean + (tau * SPREAD**2 - (1 - tau)) / variance * aside
        optimiser.zero_grad()
        (field(tau * mean + aside, tau, observation) - wanted).square().mean().backward()
        optimiser.step()
        schedule.step()
    return field.eval()


def exported(field, observation_dim, path):
    """Write a field as its own exporter writes it."""
    sizes = field.layers[-1].out_features, 1, observation_dim
    inputs = tuple(torch.zeros(2, size) for size in sizes)
    names = ["action", "tau", "observation"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        axes = {name: {0: "n"} for name in (*names, "velocity")}
        torch.onnx.export(
            field, inputs, path, dynamo=False, input_names=names, output_names=["velocity"], dynamic_axes=axes
        )
    return path


def _uniform(generator, *shape):
    return 2 * torch.rand(shape, generator=generator) - 1


def _direction(generator, count, dims):
    vector = torch.randn(count, dims, generator=generator)
    return vector / vector.norm(dim=-1, keepdim=True)


def _goal(generator, count, dims):
    """Offsets from goals, many of them short."""
    return _direction(generator, count, dims) * REACH_M * torch.rand(count, 1, generator=generator).square()


def _mates(generator, count, mates, dims):
    """Offsets from the nearest teammates, nearest first, flat; and which of them there are."""
    away = REACH_M * torch.rand(count, mates, generator=generator).sort(1)[0]
    there = torch.arange(mates) < torch.randint(0, mates + 1, (count, 1), generator=generator)
    offsets = _direction(generator, count * mates, dims).view(count, mates, dims) * away[..., None]
    return [(offsets * there[..., None]).flatten(1), there.float()]


def _towards(offset):
    """A velocity against an offset, slower where that is short."""
    return -SPEED_M_S * offset / (offset.square().sum(-1, keepdim=True) + 0.3**2).sqrt()


def _push(offsets, there, dims, sideways=0.7):
    """Away from teammates that are near, and past them on one side."""
    offsets = offsets.view(len(offsets), -1, dims)
    square = offsets.square().sum(-1, keepdim=True)
    near = (-square / (2 * CLEARANCE_M**2)).exp() * there[..., None]
    away = offsets / CLEARANCE_M
    aside = torch.cat([-away[..., 1:2], away[..., :1], 0 * away[..., 2:]], -1)
    return (near * (away + sideways * aside)).sum(1)


def _turned(vector, sine, cosine):
    x, y = vector[:, :1], vector[:, 1:2]
    return torch.cat([cosine * x - sine * y, sine * x + cosine * y], -1)


def _facts(observation, action, motion, radius_m=0.1):
    components = "\n".join(
        f'[[action]]\nname = "{name}"\nunit = "{unit}"\nlow = {-most}\nhigh = {most}'
        for name, unit, most in action
    )
    return f"""observation = [{observation}]
control_rate_hz = 10.0
euler_steps = 10
{components}
[motion]
{motion}
dt_s = 0.1
[body]
radius_m = {radius_m}
lidar_rays = 0
lidar_range_m = 0.0
"""


def _observe_glider(generator, count):
    angle = torch.pi * _uniform(generator, count, 1)
    mates = _mates(generator, count, 2, 2)
    return torch.cat([_goal(generator, count, 2), angle.sin(), angle.cos(), *mates], 1)


def _steer_glider(seen):
    goal, sine, cosine, mates, there = seen[:, :2], seen[:, 2:3], seen[:, 3:4], seen[:, 4:8], seen[:, 8:]
    forward = _towards(goal) + 0.5 * _push(mates, there, 2)
    turn = -1.5 * goal[:, 1:2] / goal.norm(dim=-1, keepdim=True).clamp_min(0.3)
    return torch.cat([_turned(forward, sine, cosine), turn], 1)


GLIDER = Policy(
    _facts(
        '{ source = "goal_offset", frame = "body" }, "heading", '
        '{ source = "teammate_offsets", count = 2, frame = "body" }, '
        '{ source = "teammates_present", count = 2 }',
        [("v_x", "m/s", 1.0), ("v_y", "m/s", 1.0), ("omega", "rad/s", 2.0)],
        'type = "velocity"\nangular = true\ntime_constant_s = 0.15',
    ),
    _observe_glider,
    _steer_glider,
)
"""Planar velocities and a yaw rate, from the goal and the two nearest in its own axes."""


def _observe_roller(generator, count):
    return torch.cat([_goal(generator, count, 2), *_mates(generator, count, 2, 2)], 1)


def _steer_roller(seen):
    goal, mates, there = seen[:, :2], seen[:, 2:6], seen[:, 6:]
    wanted = _towards(goal) + 0.4 * _push(mates, there, 2, sideways=1.5)
    speed = wanted[:, :1].clamp(0.0, 0.5)
    turn = (2.5 * wanted[:, 1:2] / wanted.norm(dim=-1, keepdim=True).clamp_min(0.15)).clamp(-2.0, 2.0)
    return torch.cat([speed, turn], 1)


ROLLER = Policy(
    _facts(
        '{ source = "goal_offset", frame = "body" }, '
        '{ source = "teammate_offsets", count = 2, frame = "body" }, '
        '{ source = "teammates_present", count = 2 }',
        [("v", "m/s", 0.6), ("omega", "rad/s", 2.5)],
        'type = "unicycle"',
    ),
    _observe_roller,
    _steer_roller,
)
"""A unicycle's forward speed and yaw rate."""


def _observe_disc(generator, count):
    angle = torch.pi * _uniform(generator, count, 1)
    velocity, turning = 0.7 * _uniform(generator, count, 2), 2.0 * _uniform(generator, count, 1)
    own = [_goal(generator, count, 2), velocity, angle.sin(), angle.cos(), turning]
    return torch.cat([*own, *_mates(generator, count, 2, 2)], 1)


def _steer_disc(seen):
    goal, velocity, cosine, turning = seen[:, :2], seen[:, 2:4], seen[:, 5:6], seen[:, 6:7]
    push = _towards(goal) + 0.5 * _push(seen[:, 7:11], seen[:, 11:], 2) - velocity
    return torch.cat([2.0 * push, 2.0 * cosine - 1.5 * turning], 1)


DISC = Policy(
    _facts(
        '"goal_offset", "velocity", "heading", "yaw_rate", '
        '{ source = "teammate_offsets", count = 2 }, { source = "teammates_present", count = 2 }',
        [("a_x", "m/s^2", 3.0), ("a_y", "m/s^2", 3.0), ("alpha", "rad/s^2", 4.0)],
        'type = "point_acceleration"\nangular = true',
    ),
    _observe_disc,
    _steer_disc,
)
"""The paper's own action in SE(2); it turns to face along y."""


def _observe_drone(generator, count):
    velocity = 0.7 * _uniform(generator, count, 3)
    return torch.cat([_goal(generator, count, 3), velocity, *_mates(generator, count, 3, 3)], 1)


def _steer_drone(seen):
    goal, velocity = seen[:, :3], seen[:, 3:6]
    away = goal[:, :2].square().sum(-1, keepdim=True)
    climb = 0.5 * away / (away + 0.2)
    wanted = torch.cat([-goal[:, :2], climb - goal[:, 2:]], -1)
    return 2.0 * (_towards(-wanted) + 0.5 * _push(seen[:, 6:15], seen[:, 15:], 3) - velocity)


DRONE = Policy(
    _facts(
        '"goal_offset", "velocity", '
        '{ source = "teammate_offsets", count = 3 }, { source = "teammates_present", count = 3 }',
        [(f"a_{axis}", "m/s^2", 3.0) for axis in "xyz"],
        'type = "point_acceleration"\ndims = 3',
    ),
    _observe_drone,
    _steer_drone,
)
"""Accelerations in space; it climbs while it is far from its goal."""

POLICIES = {"glider": GLIDER, "roller": ROLLER, "disc": DISC, "drone": DRONE}
