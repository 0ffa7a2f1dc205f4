"""A robot by rclpy; see stage.py."""

import json
import sys
import threading

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from stage import Stage
from std_msgs.msg import Bool


class Peer:
    def __init__(self, stage):
        self.stage, config = stage, stage.config
        self.kind = {"Twist": Twist, "TwistStamped": TwistStamped}[config["message"]]
        rclpy.init(args=[])
        namespace, _, name = config["node"].rpartition("/")
        self.node = node = rclpy.create_node(name, namespace=namespace or "/")
        if config.get("parameter"):
            node.declare_parameter(config["parameter"].rpartition("/")[2], config["timeout"])
        self.subscriber = None
        if config.get("command"):
            quality = QoSProfile(depth=100)
            if config.get("transient"):
                quality.durability = DurabilityPolicy.TRANSIENT_LOCAL
            self.subscriber = node.create_subscription(self.kind, config["command"], self.hear, quality)
        if config.get("odometry"):
            self.odometry = node.create_publisher(Odometry, config["odometry"], QoSProfile(depth=10))
        if config.get("stop"):
            self.pressed = config.get("pressed", False)
            quality = qos_profile_sensor_data
            if config.get("kept"):
                quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.stop = node.create_publisher(Bool, config["stop"], quality)
            self.tell_stop()
            if not config.get("kept"):
                node.create_timer(0.1, self.tell_stop)
        self.rivals = []
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(node)
        self.closing = threading.Event()
        self.thread = threading.Thread(target=self.spin)
        self.thread.start()

    def spin(self):
        while not self.closing.is_set():
            self.executor.spin_once(timeout_sec=0.1)

    def hear(self, message):
        stamped = self.kind is TwistStamped
        twist = message.twist if stamped else message
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec if stamped else 0.0
        self.stage.hear(twist.linear.x, twist.linear.y, twist.angular.z, stamp)

    def publish_odometry(self, x, y, heading, forward, stamp_s, frame):
        if not hasattr(self, "odometry"):
            return
        message = Odometry()
        message.header.stamp.sec, message.header.stamp.nanosec = int(stamp_s), int(stamp_s % 1.0 * 1e9)
        message.header.frame_id, message.child_frame_id = "odom", frame
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        message.twist.twist.linear.x = forward
        self.odometry.publish(message)

    def publish_stop(self, pressed):
        self.pressed = pressed

    def tell_stop(self):
        if self.pressed is not None:
            self.stop.publish(Bool(data=self.pressed))

    def vanish(self):
        self.node.destroy_subscription(self.subscriber)

    def rival(self, topic):
        self.rivals.append(self.node.create_publisher(self.kind, topic, QoSProfile(depth=1)))
        self.node.create_timer(1.0, lambda: self.rivals[-1].publish(self.kind()))

    def close(self):
        self.closing.set()
        self.thread.join()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()


stage = Stage(json.loads(sys.argv[1]))
peer = Peer(stage)
stage.run(peer)
peer.close()
