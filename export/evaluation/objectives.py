"""The built-in objectives' costs and slopes at B predicted motions; any other objective's, row by row."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.motion.outlook import PredictedMotion
from edge_runtime.objectives import (
    Clustering,
    Geofence,
    Objective,
    Passing,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
)
from edge_runtime.objectives.clustering import COINCIDENT_M
from export.evaluation.outlook import OutlookBatch


class SlopeBatch(NamedTuple):
    """The batched `edge_runtime.objectives.Slope`: cost (B,), d_position (B, 2), d_velocity (B, 2)."""

    cost: Floats
    d_position: Floats
    d_velocity: Floats


def evaluate_batch(
    objective: Objective, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    """Costs and slopes at B predicted motions: positions (B, 2), velocities (B, 2)."""
    evaluate = _BATCHED.get(type(objective), _row_by_row)
    return evaluate(objective, position_m, velocity_m_s, outlook)


def _row_by_row(
    objective: Objective, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    motions = np.concatenate([position_m, velocity_m_s], -1).tolist()
    slopes = [
        objective.evaluate(PredictedMotion(*motion), outlook.row(i)) for i, motion in enumerate(motions)
    ]
    table = np.array(slopes, np.float64).reshape(-1, 5)
    return SlopeBatch(table[:, 0], table[:, 1:3], table[:, 3:5])


def _speed_limit(
    objective: SpeedLimit, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    speed = np.sqrt(np.square(velocity_m_s).sum(-1))
    gain = outlook.preview.velocity_gain
    cure = np.maximum(speed - objective.limit_m_s + objective.buffer_m_s, 0.0) / gain
    pull = cure / (gain * np.maximum(speed, objective.limit_m_s - objective.buffer_m_s))
    return SlopeBatch(0.5 * cure * cure, np.zeros_like(position_m), pull[:, None] * velocity_m_s)


def _safety_margin(
    objective: SafetyMargin, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    gain = outlook.preview.position_gain
    apart = position_m[:, None] - outlook.mate_position_m
    distance = np.sqrt(np.square(apart).sum(-1))
    cure = np.maximum(objective.distance_m + objective.buffer_m - distance, 0.0) / gain
    together = distance == 0.0
    order = np.where(outlook.robot_id[:, None] < outlook.mate_id, -1.0, 1.0)
    apart[..., 0] = np.where(together, order, apart[..., 0])
    push = cure / (gain * np.where(together, 1.0, distance))
    slope = -(push[..., None] * apart).sum(1)
    return SlopeBatch(0.5 * np.square(cure).sum(-1), slope, np.zeros_like(velocity_m_s))


def _spatial_order(
    objective: SpatialOrder, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    gain, order = outlook.preview.position_gain, np.array(objective.order)
    own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
    named = own.any(-1) & mate.any(-1)
    side = np.where(own.argmax(-1) > mate.argmax(-1), 1.0, -1.0)
    ahead = side * (position_m[:, :1] - outlook.mate_position_m[..., 0])
    cure = np.where(named, np.maximum(objective.gap_m - ahead, 0.0), 0.0) / gain
    pull = np.minimum(cure, objective.pull)
    slope = np.zeros_like(position_m)
    slope[:, 0] = -(side * pull).sum(-1) / gain
    return SlopeBatch((pull * (cure - 0.5 * pull)).sum(-1), slope, np.zeros_like(velocity_m_s))


def _spacing(
    objective: Spacing, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    if outlook.mate_id.shape[1] == 0:
        nothing = np.zeros_like(position_m)
        return SlopeBatch(nothing[:, 0], nothing, nothing)
    apart = position_m[:, None] - outlook.mate_position_m
    square, rows = np.square(apart).sum(-1), np.arange(len(apart))
    closest = square.argmin(1)
    away, distance = apart[rows, closest], np.sqrt(square[rows, closest])
    gain = outlook.preview.position_gain
    cure = (objective.distance_m - distance) / gain
    together = distance == 0.0
    order = np.where(outlook.robot_id < outlook.mate_id[rows, closest], -1.0, 1.0)
    away[:, 0] = np.where(together, order, away[:, 0])
    push = cure / (gain * np.where(together, 1.0, distance))
    return SlopeBatch(0.5 * np.square(cure), -push[:, None] * away, np.zeros_like(velocity_m_s))


def _geofence(
    objective: Geofence, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    gain = outlook.preview.position_gain
    offset = position_m - objective.centre_m
    distance = np.sqrt(np.square(offset).sum(-1))
    cure = np.maximum(objective.radius_m + objective.buffer_m - distance, 0.0) / gain
    amid = distance == 0.0
    offset[:, 0] = np.where(amid, 1.0, offset[:, 0])
    push = cure / (gain * np.where(amid, 1.0, distance))
    return SlopeBatch(0.5 * cure * cure, -push[:, None] * offset, np.zeros_like(velocity_m_s))


def _clustering(
    objective: Clustering, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    gain, count = outlook.preview.position_gain, outlook.mate_id.shape[1] + 1
    if count == 1:
        return SlopeBatch(np.zeros(len(position_m)), np.zeros_like(position_m), np.zeros_like(velocity_m_s))
    team = np.concatenate([position_m[:, None], outlook.mate_position_m], 1)
    offset = team - team.sum(1, keepdims=True) / count
    distance = np.sqrt(np.square(offset).sum(-1))
    ids = np.concatenate([outlook.robot_id[:, None], outlook.mate_id], 1)
    angle = 2.0 * math.pi * (ids[:, None] < ids[:, :, None]).sum(-1) / count
    amid = distance < COINCIDENT_M
    outward = np.where(amid[..., None], np.stack([np.cos(angle), np.sin(angle)], -1), offset)
    outward /= np.where(amid, 1.0, distance)[..., None]
    cure = (distance.mean(-1) - objective.radius_m) / gain
    slope = (cure / (gain * count))[:, None] * (outward[:, 0] - outward.mean(1))
    return SlopeBatch(0.5 * cure * cure, slope, np.zeros_like(velocity_m_s))


def _passing(
    objective: Passing, position_m: Floats, velocity_m_s: Floats, outlook: OutlookBatch
) -> SlopeBatch:
    gain, order = outlook.preview.position_gain, np.array(objective.order)
    own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
    later = own.any(-1) & mate.any(-1) & (own.argmax(-1) > mate.argmax(-1))
    apart = outlook.drift_position_m[:, None] - outlook.mate_position_m
    near = np.square(apart).sum(-1) < objective.reach_m * objective.reach_m
    passing = later & near & (apart[..., 0] < objective.margin_m)
    missing = objective.clearance_m + position_m[:, 1:] - outlook.mate_position_m[..., 1]
    cure = np.where(passing, np.maximum(missing, 0.0), 0.0) / gain
    pull = np.minimum(cure, objective.pull)
    slope = np.zeros_like(position_m)
    slope[:, 1] = pull.sum(-1) / gain
    return SlopeBatch((pull * (cure - 0.5 * pull)).sum(-1), slope, np.zeros_like(velocity_m_s))


_BATCHED: dict[type[Objective], Callable[[Any, Floats, Floats, OutlookBatch], SlopeBatch]] = {
    SpeedLimit: _speed_limit,
    SafetyMargin: _safety_margin,
    SpatialOrder: _spatial_order,
    Spacing: _spacing,
    Geofence: _geofence,
    Clustering: _clustering,
    Passing: _passing,
}
