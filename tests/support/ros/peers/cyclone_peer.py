"""A robot by Cyclone DDS without ROS, independent of the DDS that rclpy uses here; see stage.py.

Names and types are as ROS 2 writes them into DDS: ``rt/`` before a topic, ``dds_`` within a type. It has no
parameters, so a controller's node stands beside it.
"""

import json
import os
import sys
import threading
from dataclasses import dataclass

from cyclonedds.core import ReadCondition, SampleState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int32, uint32
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from stage import Stage

LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility></Domain></CycloneDDS>"""


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


class Peer:
    def __init__(self, stage):
        self.stage, config = stage, stage.config
        self.kind = {"Twist": Twist, "TwistStamped": TwistStamped}[config["message"]]
        number = int(os.environ["ROS_DOMAIN_ID"])
        self.domain = Domain(number, LOOPBACK)
        self.participant = DomainParticipant(number)
        quality = Qos(
            Policy.Reliability.Reliable(duration(milliseconds=100)),
            Policy.History.KeepLast(100),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        commands = Topic(self.participant, "rt" + config["command"], self.kind)
        self.reader = DataReader(self.participant, commands, quality)
        odometry = Topic(self.participant, "rt" + config["odometry"], Odometry)
        self.writer = DataWriter(self.participant, odometry, quality)
        self.closing = threading.Event()
        self.thread = threading.Thread(target=self.listen)
        self.thread.start()

    def listen(self):
        waiting = WaitSet(self.participant)
        waiting.attach(ReadCondition(self.reader, SampleState.NotRead))
        while not self.closing.is_set():
            waiting.wait(duration(milliseconds=100))
            for message in self.reader.take(100):
                if isinstance(message, InvalidSample):  # the writer has left
                    continue
                stamped = self.kind is TwistStamped
                twist = message.twist if stamped else message
                stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec if stamped else 0.0
                self.stage.hear(twist.linear.x, twist.linear.y, twist.angular.z, stamp)

    def publish_odometry(self, x, y, heading, forward, stamp_s, frame):
        none = [0.0] * 36
        stamp = Time(int(stamp_s), int(stamp_s % 1.0 * 1e9))
        pose = Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
        twist = Twist(Vector3(x=forward), Vector3())
        self.writer.write(
            Odometry(
                Header(stamp, "odom"), frame, PoseWithCovariance(pose, none), TwistWithCovariance(twist, none)
            )
        )

    def close(self):
        self.closing.set()
        self.thread.join()


stage = Stage(json.loads(sys.argv[1]))
peer = Peer(stage)
stage.run(peer)
peer.close()
