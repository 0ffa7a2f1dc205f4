"""From pymavlink's messages to records; None where one is not finite, or its axes say nothing of north."""

import math
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect  # type: ignore[import-untyped]

from firmware_bridge.mavlink.messages import (
    Attitude,
    CommandResult,
    Content,
    EstimatorStatus,
    GpsFix,
    Heartbeat,
    Landed,
    LocalPosition,
    MessageInterval,
    Odometry,
    Parameter,
    StatusText,
    TimeSync,
)

DialectMessage: TypeAlias = Any
"""An object of pymavlink, which has no types."""


def _heartbeat(message: DialectMessage) -> Content:
    armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    return Heartbeat(message.custom_mode, armed, message.type, message.autopilot, message.system_status)


def _attitude(message: DialectMessage) -> Content | None:
    if not _finite(message.yaw, message.yawspeed):
        return None
    return Attitude(message.time_boot_ms * 1e-3, message.yaw, message.yawspeed)


def _local_position(message: DialectMessage) -> Content | None:
    position, velocity = (message.x, message.y), (message.vx, message.vy)
    if not _finite(*position, *velocity):
        return None
    return LocalPosition(message.time_boot_ms * 1e-3, position, velocity, message.z, message.vz)


def _odometry(message: DialectMessage) -> Content | None:
    axes = (message.frame_id, message.child_frame_id)
    if axes != (dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_FRD):
        return None
    position, velocity, attitude = (message.x, message.y), (message.vx, message.vy), tuple(message.q)
    if not _finite(*position, *velocity, *attitude, message.yawspeed):
        return None
    boot_s, turn = message.time_usec * 1e-6, message.yawspeed
    return Odometry(boot_s, position, velocity, attitude, turn, message.reset_counter, message.z, message.vz)


def _estimator_status(message: DialectMessage) -> Content | None:
    return _estimator(message.flags, message.vel_ratio, message.pos_horiz_ratio)


def _ekf_status(message: DialectMessage) -> Content | None:
    return _estimator(message.flags, message.velocity_variance, message.pos_horiz_variance)


def _estimator(flags: int, velocity: float, position: float) -> Content | None:
    return EstimatorStatus(flags, max(velocity, position)) if _finite(velocity, position) else None


def _gps_fix(message: DialectMessage) -> Content:
    return GpsFix(message.fix_type, message.time_usec)


def _landed(message: DialectMessage) -> Content:
    return Landed(message.landed_state)


def _time_sync(message: DialectMessage) -> Content:
    return TimeSync(message.tc1, message.ts1)


def _parameter(message: DialectMessage) -> Content | None:
    if not _finite(message.param_value):
        return None
    real = message.param_type == dialect.MAV_PARAM_TYPE_REAL32
    return Parameter(message.param_id, message.param_value, real)


def _status_text(message: DialectMessage) -> Content:
    return StatusText(message.severity, message.text)


def _command_result(message: DialectMessage) -> Content:
    return CommandResult(message.command, message.result)


def _message_interval(message: DialectMessage) -> Content:
    return MessageInterval(message.message_id, message.interval_us)


READERS = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    dialect.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_fix,
    dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
    dialect.MAVLINK_MSG_ID_TIMESYNC: _time_sync,
    dialect.MAVLINK_MSG_ID_PARAM_VALUE: _parameter,
    dialect.MAVLINK_MSG_ID_STATUSTEXT: _status_text,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: _command_result,
    dialect.MAVLINK_MSG_ID_MESSAGE_INTERVAL: _message_interval,
}
"""By message number; what is not here is of no interest."""


def _finite(*numbers: float) -> bool:
    return all(math.isfinite(number) for number in numbers)
