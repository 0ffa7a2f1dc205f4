"""Every motion model's steps in float64 PyTorch, from their equations and independent of the runtime."""

import torch

from edge_runtime.motion.models import LinearTable, PointAcceleration, PointForce, Unicycle, VelocityLag


def tensor(values):
    return torch.as_tensor(values, dtype=torch.float64)


def rolled_out(model, state, action, steps):
    """(position, velocity, heading, yaw rate) after so many steps under an action (d,) with gradients."""
    motion = (
        tensor(state.position_m),
        tensor(state.velocity_m_s),
        tensor(state.heading_rad),
        tensor(state.yaw_rate_rad_s),
    )
    for _ in range(steps):
        motion = _STEPS[type(model)](model, action, *motion)
    return motion


def _pushed(place, speed, acceleration, drag, model):
    speed = speed * (1 - drag)
    for _ in range(model.substeps):
        speed = speed + acceleration * (model.dt_s / model.substeps)
        place = place + speed * (model.dt_s / model.substeps)
    return place, speed


def _force(model, u, p, v, heading, yaw_rate):
    p, v = _pushed(p, v, u[: model.dims] / model.mass_kg, model.drag, model)
    if model.turns:
        angular = u[-1] / model.inertia_kg_m2
        heading, yaw_rate = _pushed(heading, yaw_rate, angular, model.yaw_drag, model)
    return p, v, heading, yaw_rate


def _acceleration(model, u, p, v, heading, yaw_rate):
    p, v = _pushed(p, v, model.gain * u[: model.dims], model.drag, model)
    if model.turns:
        heading, yaw_rate = _pushed(heading, yaw_rate, u[-1], model.yaw_drag, model)
    return p, v, heading, yaw_rate


def _lagging(place, speed, wanted, constant, h):
    """dv/dt = (wanted - v) / constant by the exponential of the matrix of (p, v, wanted); or at once."""
    if not constant:
        return place + h * wanted, wanted + 0 * speed
    rates = tensor([[0.0, 1.0, 0.0], [0.0, -1.0 / constant, 1.0 / constant], [0.0, 0.0, 0.0]])
    (_, along, by_wanted), (_, kept, followed), _ = torch.linalg.matrix_exp(h * rates)
    return place + along * speed + by_wanted * wanted, kept * speed + followed * wanted


def _velocity(model, u, p, v, heading, yaw_rate):
    p, v = _lagging(p, v, model.gain * u[: model.dims], model.time_constant_s, model.dt_s)
    if model.turns:
        heading, yaw_rate = _lagging(heading, yaw_rate, u[-1], model.yaw_time_constant_s, model.dt_s)
    return p, v, heading, yaw_rate


def _unicycle(model, u, p, v, heading, yaw_rate):
    h, speed = model.dt_s, v[0] * torch.cos(heading) + v[1] * torch.sin(heading)
    speed = model.gain * u[0] if model.forward == "speed" else speed + model.gain * u[0] * h
    yaw_rate = u[1] if model.turn == "rate" else yaw_rate + u[1] * h
    middle = heading + yaw_rate * h / 2
    p = p + speed * h * torch.stack([torch.cos(middle), torch.sin(middle)])
    heading = heading + yaw_rate * h
    return p, speed * torch.stack([torch.cos(heading), torch.sin(heading)]), heading, yaw_rate


def _table(model, u, p, v, heading, yaw_rate):
    p = p + tensor(model.position_decay) * v + tensor(model.position_gain) @ u
    v = tensor(model.velocity_decay) * v + tensor(model.velocity_gain) @ u
    if model.turns:
        heading = heading + model.heading_decay * yaw_rate + tensor(model.heading_gain) @ u
        yaw_rate = model.yaw_rate_decay * yaw_rate + tensor(model.yaw_rate_gain) @ u
    return p, v, heading, yaw_rate


_STEPS = {
    PointForce: _force,
    PointAcceleration: _acceleration,
    VelocityLag: _velocity,
    Unicycle: _unicycle,
    LinearTable: _table,
}
