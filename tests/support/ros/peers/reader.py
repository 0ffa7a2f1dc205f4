"""Somebody's own node that watches a team: ``reader.py 1|2``; prints what it hears of it, in JSON."""

import json
import sys

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from visualization_msgs.msg import MarkerArray


def say(**words):
    sys.stdout.write(json.dumps(words) + "\n")  # at once, from any thread
    sys.stdout.flush()


def diagnostics(array):
    for one in array.status:
        level = one.level[0] if isinstance(one.level, bytes) else one.level
        values = {pair.key: pair.value for pair in one.values}
        say(diagnostics=one.hardware_id, level=level, message=one.message, values=values)


def path(heard):
    if heard.poses:
        place = heard.poses[-1].pose.position
        say(path=[place.x, place.y], length=len(heard.poses), frame=heard.header.frame_id)


def robots(array):
    for one in array.markers:
        say(marker=one.id, place=[one.pose.position.x, one.pose.position.y])


TOPICS = (("/diagnostics", DiagnosticArray, diagnostics), ("/cfpg/robot_0/path", Path, path),
          ("/cfpg/robots", MarkerArray, robots))  # fmt: skip
if sys.argv[1] == "1":
    import rospy

    rospy.init_node("reader", disable_signals=True, disable_rosout=True)
    subscribers = [rospy.Subscriber(topic, kind, hear) for topic, kind, hear in TOPICS]
    sys.stdin.read()
else:
    import rclpy

    rclpy.init(args=[])
    node = rclpy.create_node("reader")
    subscribers = [node.create_subscription(kind, topic, hear, 10) for topic, kind, hear in TOPICS]
    rclpy.spin(node)
