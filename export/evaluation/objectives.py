"""The built-in objectives' costs and slopes at B predicted motions; any other objective's, row by row."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from edge_runtime.common.arrays import Floats
from edge_runtime.motion.prediction import PredictedMotion
from edge_runtime.objectives import (
    Attraction,
    Clustering,
    Geofence,
    Objective,
    Passing,
    SafetyMargin,
    Spacing,
    SpatialOrder,
    SpeedLimit,
    TrackedMargin,
)
from edge_runtime.objectives.clustering import COINCIDENT_M
from export.evaluation.outlook import COMPONENTS, POSITION, VELOCITY, MotionBatch, OutlookBatch


class SlopeBatch(NamedTuple):
    """The batched `edge_runtime.objectives.Slope`."""

    cost: Floats
    """(B,)"""
    d_motion: Floats
    """(B, C) in the order of a `PredictedMotion`."""


def evaluate_batch(objective: Objective, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    """Costs and slopes at B predicted motions."""
    evaluate = _BATCHED.get(type(objective), _row_by_row)
    return evaluate(objective, motion, outlook)


def _row_by_row(objective: Objective, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    table = np.zeros((len(motion.position_m), 1 + COMPONENTS))
    for index, row in enumerate(_components(motion).tolist()):
        slope = objective.evaluate(PredictedMotion(*row), outlook.row(index))
        table[index, : len(slope)] = slope
    return SlopeBatch(table[:, 0], table[:, 1:])


def _components(motion: MotionBatch) -> Floats:
    """Motions as (B, C) in the order of a `PredictedMotion`."""
    dims = motion.position_m.shape[-1]
    table = np.zeros((len(motion.position_m), COMPONENTS))
    table[:, POSITION[:dims]], table[:, VELOCITY[:dims]] = motion.position_m, motion.velocity_m_s
    table[:, 6], table[:, 7] = motion.heading_rad, motion.yaw_rate_rad_s
    return table


def _over(components: Sequence[int], cost: Floats, slope: Floats) -> SlopeBatch:
    """A cost of positions or velocities alone, with its slope (B, dims) over them."""
    d_motion = np.zeros((len(cost), COMPONENTS))
    d_motion[:, components[: slope.shape[-1]]] = slope
    return SlopeBatch(cost, d_motion)


def _speed_limit(objective: SpeedLimit, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    speed, gain = np.sqrt(np.square(motion.velocity_m_s).sum(-1)), outlook.preview.velocity_gain
    cure = np.maximum(speed - objective.limit_m_s + objective.buffer_m_s, 0.0) / gain
    pull = cure / (gain * np.maximum(speed, objective.limit_m_s - objective.buffer_m_s))
    return _over(VELOCITY, 0.5 * cure * cure, pull[:, None] * motion.velocity_m_s)


def _safety_margin(objective: SafetyMargin, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    order = np.where(outlook.robot_id[:, None] < outlook.mate_id, -1.0, 1.0)
    return _keep_clear(objective, motion, outlook.mates.position_m, order, outlook)


def _tracked_margin(objective: TrackedMargin, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    there = outlook.tracked_m(objective.object)
    return _keep_clear(objective, motion, there, np.ones(there.shape[:2]), outlook)


def _keep_clear(
    objective: SafetyMargin | TrackedMargin,
    motion: MotionBatch,
    points_m: Floats,
    order: Floats,
    outlook: OutlookBatch,
) -> SlopeBatch:
    """Of (B, K) points; ``order`` (B, K) tells in which direction along x to leave one that coincides."""
    gain = outlook.preview.position_gain
    apart = motion.position_m[:, None] - points_m
    distance = np.sqrt(np.square(apart).sum(-1))
    cure = np.maximum(objective.distance_m + objective.buffer_m - distance, 0.0) / gain
    together = distance == 0.0
    apart[..., 0] = np.where(together, order, apart[..., 0])
    push = cure / (gain * np.where(together, 1.0, distance))
    return _over(POSITION, 0.5 * np.square(cure).sum(-1), -(push[..., None] * apart).sum(1))


def _spatial_order(objective: SpatialOrder, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    gain, order = outlook.preview.position_gain, np.array(objective.order)
    own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
    named = own.any(-1) & mate.any(-1)
    side = np.where(own.argmax(-1) > mate.argmax(-1), 1.0, -1.0)
    ahead = side * (motion.position_m[:, :1] - outlook.mates.position_m[..., 0])
    cure = np.where(named, np.maximum(objective.gap_m - ahead, 0.0), 0.0) / gain
    pull = np.minimum(cure, objective.pull)
    slope = np.zeros_like(motion.position_m)
    slope[:, 0] = -(side * pull).sum(-1) / gain
    return _over(POSITION, (pull * (cure - 0.5 * pull)).sum(-1), slope)


def _spacing(objective: Spacing, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    if outlook.mate_id.shape[1] == 0:
        return _over(POSITION, np.zeros(len(motion.position_m)), np.zeros_like(motion.position_m))
    apart = motion.position_m[:, None] - outlook.mates.position_m
    square, rows = np.square(apart).sum(-1), np.arange(len(apart))
    closest = square.argmin(1)
    away, distance = apart[rows, closest], np.sqrt(square[rows, closest])
    gain = outlook.preview.position_gain
    cure = (objective.distance_m - distance) / gain
    together = distance == 0.0
    order = np.where(outlook.robot_id < outlook.mate_id[rows, closest], -1.0, 1.0)
    away[:, 0] = np.where(together, order, away[:, 0])
    push = cure / (gain * np.where(together, 1.0, distance))
    return _over(POSITION, 0.5 * np.square(cure), -push[:, None] * away)


def _geofence(objective: Geofence, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    gain, around = outlook.preview.position_gain, len(objective.centre_m)
    offset = motion.position_m[:, :around] - objective.centre_m
    distance = np.sqrt(np.square(offset).sum(-1))
    cure = np.maximum(objective.radius_m + objective.buffer_m - distance, 0.0) / gain
    amid = distance == 0.0
    offset[:, 0] = np.where(amid, 1.0, offset[:, 0])
    push = cure / (gain * np.where(amid, 1.0, distance))
    return _over(POSITION, 0.5 * cure * cure, -push[:, None] * offset)


def _clustering(objective: Clustering, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    gain, count = outlook.preview.position_gain, outlook.mate_id.shape[1] + 1
    if count == 1:
        return _over(POSITION, np.zeros(len(motion.position_m)), np.zeros_like(motion.position_m))
    team = np.concatenate([motion.position_m[:, None], outlook.mates.position_m], 1)
    offset = team - team.sum(1, keepdims=True) / count
    distance = np.sqrt(np.square(offset).sum(-1))
    ids = np.concatenate([outlook.robot_id[:, None], outlook.mate_id], 1)
    angle = 2.0 * math.pi * (ids[:, None] < ids[:, :, None]).sum(-1) / count
    amid = distance < COINCIDENT_M
    out = np.zeros_like(offset)
    out[..., 0], out[..., 1] = np.cos(angle), np.sin(angle)
    outward = np.where(amid[..., None], out, offset)
    outward /= np.where(amid, 1.0, distance)[..., None]
    cure = (distance.mean(-1) - objective.radius_m) / gain
    slope = (cure / (gain * count))[:, None] * (outward[:, 0] - outward.mean(1))
    return _over(POSITION, 0.5 * cure * cure, slope)


def _attraction(objective: Attraction, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    gain, there = outlook.preview.position_gain, outlook.tracked_m(objective.object)
    if not there.shape[1]:
        return _over(POSITION, np.zeros(len(motion.position_m)), np.zeros_like(motion.position_m))
    team = np.concatenate([motion.position_m[:, None], outlook.mates.position_m], 1)
    apart = team.mean(1) - there[:, 0]
    distance = np.sqrt(np.square(apart).sum(-1))
    cure = distance / gain
    pull = np.minimum(cure, objective.pull)
    push = pull / (gain * np.where(distance == 0.0, 1.0, distance))
    return _over(POSITION, team.shape[1] * pull * (cure - 0.5 * pull), push[:, None] * apart)


def _passing(objective: Passing, motion: MotionBatch, outlook: OutlookBatch) -> SlopeBatch:
    gain, order = outlook.preview.position_gain, np.array(objective.order)
    own, mate = outlook.robot_id[:, None, None] == order, outlook.mate_id[..., None] == order
    later = own.any(-1) & mate.any(-1) & (own.argmax(-1) > mate.argmax(-1))
    apart = outlook.drift.position_m[:, None] - outlook.mates.position_m
    near = np.square(apart).sum(-1) < objective.reach_m * objective.reach_m
    passing = later & near & (apart[..., 0] < objective.margin_m)
    missing = objective.clearance_m + motion.position_m[:, 1:] - outlook.mates.position_m[..., 1]
    cure = np.where(passing, np.maximum(missing, 0.0), 0.0) / gain
    pull = np.minimum(cure, objective.pull)
    slope = np.zeros_like(motion.position_m)
    slope[:, 1] = pull.sum(-1) / gain
    return _over(POSITION, (pull * (cure - 0.5 * pull)).sum(-1), slope)


_BATCHED: dict[type[Objective], Callable[[Any, MotionBatch, OutlookBatch], SlopeBatch]] = {
    SpeedLimit: _speed_limit,
    SafetyMargin: _safety_margin,
    SpatialOrder: _spatial_order,
    Spacing: _spacing,
    Geofence: _geofence,
    Clustering: _clustering,
    Passing: _passing,
    TrackedMargin: _tracked_margin,
    Attraction: _attraction,
}
