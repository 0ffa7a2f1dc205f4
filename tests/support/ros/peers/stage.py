"""A robot's ROS node as a test directs it: words come in on stdin, what it hears goes out on stdout, in JSON.

It stands still when its controller's timeout passes without a command, and says so.


``PEER CONFIG`` with CONFIG in JSON: names of topics, message kind, node. A library's peer is a class with
``publish_odometry(x, y, heading, forward, stamp_s, frame)``, ``publish_stop(pressed)``, ``command(...)``.
"""

import json
import select
import sys
import threading
import time

PERIOD_S = 0.02


class Stage:
    """Publishes odometry at 50 Hz, integrates what it is commanded, obeys the test."""

    def __init__(self, config):
        self.config = config
        self.x, self.speed, self.heard = 0.0, 0.0, 0
        self.odometry, self.frame, self.stamp_s, self.y = True, config.get("frame", "base_link"), None, 0.0
        self.late_s = 0.0
        self.last, self.timeout_s = None, config.get("timeout")
        self._lock = threading.Lock()

    def say(self, **words):
        with self._lock:
            sys.stdout.write(json.dumps(words) + "\n")
            sys.stdout.flush()

    def hear(self, forward, lateral, yaw, stamp_s=0.0):
        """From the library's thread: one command has arrived."""
        self.speed, self.last = forward, time.monotonic()
        self.say(command=[forward, lateral, yaw], at=time.monotonic(), stamp=stamp_s)

    def run(self, peer):
        self.say(ready=True)
        due = time.monotonic()
        while True:
            due += PERIOD_S
            readable = select.select([sys.stdin], [], [], max(due - time.monotonic(), 0.0))[0]
            if readable:
                line = sys.stdin.readline()
                if not line:
                    return
                word, *arguments = json.loads(line)
                if word == "end":
                    return
                self.obey(peer, word, arguments)
                due -= PERIOD_S
                continue
            if self.last and self.timeout_s and time.monotonic() > self.last + self.timeout_s:
                self.say(timed_out=time.monotonic() - self.last, speed=self.speed)
                self.speed, self.last = 0.0, None
            self.x += self.speed * PERIOD_S
            if self.odometry:
                stamp = time.time() - self.late_s if self.stamp_s is None else self.stamp_s
                peer.publish_odometry(self.x, self.y, 0.0, self.speed, stamp, self.frame)

    def obey(self, peer, word, arguments):
        if word == "set":  # of what is published
            setattr(self, *arguments)
        else:
            getattr(peer, word)(*arguments)
        self.say(done=word)
