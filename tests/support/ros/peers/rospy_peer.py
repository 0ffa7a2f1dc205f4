"""A robot by rospy; see stage.py."""

import json
import sys

import rospy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from stage import Stage
from std_msgs.msg import Bool


class Peer:
    def __init__(self, stage):
        self.stage, config = stage, stage.config
        self.kind = {"Twist": Twist, "TwistStamped": TwistStamped}[config["message"]]
        rospy.init_node(config["node"], argv=[], disable_signals=True, disable_rosout=True)
        if config.get("parameter"):
            rospy.set_param(config["parameter"], config["timeout"])
        for name, value in config.get("parameters", {}).items():
            rospy.set_param(name, value)
        self.subscriber = None
        if config.get("command"):
            self.subscriber = rospy.Subscriber(config["command"], self.kind, self.hear, tcp_nodelay=True)
        if config.get("odometry"):
            self.odometry = rospy.Publisher(config["odometry"], Odometry, queue_size=1, tcp_nodelay=True)
        if config.get("stop"):
            self.stop = rospy.Publisher(config["stop"], Bool, queue_size=1, latch=True)
            self.publish_stop(config.get("pressed", False))
        self.rivals = []

    def hear(self, message):
        stamped = self.kind is TwistStamped
        twist = message.twist if stamped else message
        stamp = message.header.stamp.to_sec() if stamped else 0.0
        self.stage.hear(twist.linear.x, twist.linear.y, twist.angular.z, stamp)

    def publish_odometry(self, x, y, heading, forward, stamp_s, frame):
        if not hasattr(self, "odometry"):
            return
        message = Odometry()
        message.header.stamp = rospy.Time.from_sec(stamp_s)
        message.header.frame_id, message.child_frame_id = "odom", frame
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        message.pose.pose.orientation.w = 1.0
        message.twist.twist.linear.x = forward
        self.odometry.publish(message)

    def publish_stop(self, pressed):
        self.stop.publish(Bool(pressed))

    def vanish(self):
        self.subscriber.unregister()

    def rival(self, topic):
        rival = rospy.Publisher(topic, self.kind, queue_size=1)
        self.rivals.append(rospy.Timer(rospy.Duration(1.0), lambda _: rival.publish(self.kind())))

    def close(self):
        rospy.signal_shutdown("closed")


stage = Stage(json.loads(sys.argv[1]))
peer = Peer(stage)
stage.run(peer)
peer.close()
