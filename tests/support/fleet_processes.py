"""Teams of processes on the loopback."""

import json
import signal
import subprocess
import sys
import threading
from pathlib import Path

from bundles import MANIFEST
from paths import SUPPORT
from ports import free_port
from waiting import HANG_S

from edge_runtime.config.fleet import load_fleet
from edge_runtime.control.mission import Mission
from edge_runtime.messages import RobotState
from edge_runtime.network.order_wire import Stop, encode_order
from edge_runtime.network.seal import Magic
from edge_runtime.network.team_wire import FRAME_BYTES, Frame, encode
from edge_runtime.policy.bundle import Bundle

UNREACHABLE = 2**40
"""A sequence that no robot of these tests reaches."""


def mission(path, robot_id=0):
    fleet = load_fleet(path)
    return Mission(robot_id, fleet, Bundle(MANIFEST, None, Path()), fleet.objective_set, 50.0)


def robot(robot_id, extra=""):
    host, port = free_port()
    place = f"start_m = [0, {robot_id}]\ngoal_m = [1, {robot_id}]"
    return f'[[robots]]\nid = {robot_id}\n{place}\naddress = "{host}:{port}"\n{extra}\n'


class Process:
    """A robot of the team in a process of its own."""

    def __init__(self, path, robot_id, loss, stack):
        program = SUPPORT / "fleet_process.py"
        command = [sys.executable, str(program), str(path), str(robot_id), str(loss)]
        self.process = stack.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        self.reader = None
        stack.callback(self._kill)

    def _kill(self):
        self.process.kill()
        if self.reader:
            self.reader.join()

    def tick(self):
        return json.loads(self.process.stdout.readline())

    def read_on(self):
        """Read in a thread from here on: a full pipe would hold the process up."""
        self.rows = []
        self.reader = threading.Thread(target=lambda: self.rows.extend(map(json.loads, self.process.stdout)))
        self.reader.start()

    def rest(self):
        """The ticks read in the thread, and the report, of a process that ends by itself."""
        self.reader.join(HANG_S)
        assert self.process.wait(HANG_S) == 0
        *ticks, report = self.rows
        return ticks, report

    def end(self):
        """The ticks not read yet, and the report."""
        self.process.send_signal(signal.SIGTERM)
        *ticks, report = map(json.loads, self.process.stdout)
        assert self.process.wait() == 0
        return ticks, report


def hostile(draw):
    """A frame by somebody who knows everything but the key."""
    state = RobotState(draw.choice([1, 2]), draw.uniform(0, 1e6), (9.0, 9.0), (0.0, 0.0))
    sequence = UNREACHABLE + draw.randrange(2**32)
    frame = Frame(
        0, draw.getrandbits(64), sequence, draw.getrandbits(64), draw.getrandbits(64), state, (1.0, 1.0)
    )
    packet = bytearray(encode(frame, draw.randbytes(32)))
    kind = draw.randrange(6)
    if kind == 0:
        return draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    if kind == 1:
        packet[-32:] = bytes(32)
    elif kind == 2:
        packet = packet[: draw.randrange(FRAME_BYTES)]
    elif kind == 3:
        packet = encode_order(Stop(1, 2, 0, draw.getrandbits(64), 1e12), draw.randbytes(32))
    elif kind == 4:
        packet = Magic.ORDER + draw.randbytes(draw.randrange(2 * FRAME_BYTES))
    return bytes(packet)
