"""Range readings of robots that see each other's discs, as VMAS casts them, for all teams at once."""

import math

import torch
from torch import Tensor

from edge_runtime.motion.body import Body


def disc_ranges(position: Tensor, body: Body) -> Tensor:
    """Readings (B, N, R) in metres of the sensors of robots at ``position`` (B, N, 2).

    The rays turn counter-clockwise. A disc counts where its centre lies ahead of the ray; the reading is
    the ray's first crossing with its rim, below zero from inside the disc, and the sensor's range where
    nothing is met.
    """
    reading = position.new_full((*position.shape[:2], body.lidar_rays), body.lidar_range_m)
    turn = 2 * math.pi / body.lidar_rays
    angle = body.lidar_start_rad + turn * torch.arange(body.lidar_rays, device=position.device)
    offset = position[:, None] - position[:, :, None]
    others = ~torch.eye(position.shape[1], dtype=torch.bool, device=position.device)
    near = offset.square().sum(-1) < (body.lidar_range_m + body.radius_m) ** 2
    team, robot, mate = (near & others).nonzero(as_tuple=True)
    x, y = offset[team, robot, mate].unbind(-1)
    ahead = x[:, None] * angle.cos() + y[:, None] * angle.sin()
    aside = x[:, None] * angle.sin() - y[:, None] * angle.cos()
    chord = body.radius_m**2 - aside.square()
    met = (ahead > 0) & (chord > 0)
    seen = torch.where(met, ahead - chord.clamp_min(0).sqrt(), body.lidar_range_m)
    seat = (team * position.shape[1] + robot)[:, None].expand_as(seen)
    reading.view(-1, body.lidar_rays).scatter_reduce_(0, seat, seen, "amin")
    return reading
