"""A PX4-like autopilot made of the MAVSDK library: an implementation of MAVLink that nobody here wrote.

``python mavsdk_autopilot.py PORT`` listens on 127.0.0.1:PORT, prints one JSON line an event, obeys the
operator's lines on standard input (``mode HOLD``, ``disarm``, ``quit``). The library says neither which
autopilot it is nor of which vehicle; what leaves this process says PX4 and rover.
"""

import json
import socket
import struct
import sys
import threading
import time

from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action_server.action_server import ActionServer, AllowableFlightModes, FlightMode
from mavsdk.plugins.mavlink_direct_server.mavlink_direct_server import MavlinkDirectServer, MavlinkMessage
from mavsdk.plugins.param_server.param_server import ParamServer
from pymavlink.dialects.v20 import common

COMMAND_TIMEOUT_S = 0.5
TELEMETRY_S = 0.02


HEARTBEAT = struct.Struct("<IBB3s")
"""Mode, type, autopilot, and the rest."""


def as_px4_rover(frame):
    """Return a frame; a heartbeat's with the type and autopilot that the library leaves open."""
    if int.from_bytes(frame[7:10], "little") != common.MAVLINK_MSG_ID_HEARTBEAT:
        return frame
    mode, _, _, rest = HEARTBEAT.unpack(frame[10:-2].ljust(HEARTBEAT.size, b"\0"))
    payload = HEARTBEAT.pack(mode, common.MAV_TYPE_GROUND_ROVER, common.MAV_AUTOPILOT_PX4, rest)
    header = bytes([frame[0], len(payload)]) + frame[2:10]
    checksum = common.x25crc(header[1:] + payload)
    checksum.accumulate(bytes([common.MAVLink_heartbeat_message.crc_extra]))
    return header + payload + struct.pack("<H", checksum.crc)


class Port:
    """A UDP socket between the library and whoever spoke last."""

    def __init__(self, number, mavsdk):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", number))
        self.peer, self.mavsdk = None, mavsdk
        mavsdk.add_any_connection("raw://")
        mavsdk.subscribe_raw_bytes_to_be_sent(self.send)
        threading.Thread(target=self.receive, daemon=True).start()

    def send(self, frame):
        if self.peer is not None:
            self.socket.sendto(as_px4_rover(frame), self.peer)

    def receive(self):
        while True:
            data, self.peer = self.socket.recvfrom(2048)
            self.mavsdk.pass_received_raw_bytes(data)


class Autopilot:
    def __init__(self, port):
        self.mavsdk = Mavsdk(Configuration.create_manual(1, 1, True))
        self.port = Port(port, self.mavsdk)
        component = self.mavsdk.server_component()
        self.actions, self.direct = ActionServer(component), MavlinkDirectServer(component)
        self.parameters = ParamServer(component)
        self.parameters.provide_param_float("COM_OF_LOSS_T", COMMAND_TIMEOUT_S)
        self.actions.set_armable(True, True)
        self.actions.set_disarmable(True, True)
        self.actions.set_allowable_flight_modes(AllowableFlightModes(can_guided_mode=True))
        self.actions.subscribe_arm_disarm(lambda _, request, __: self.tell("arm", armed=request.arm))
        self.actions.subscribe_flight_mode_change(lambda _, mode, __: self.change_mode(mode))
        self.listen("SET_POSITION_TARGET_LOCAL_NED", lambda fields: self.tell("setpoint", **fields))
        self.listen("HEARTBEAT", lambda fields: self.tell("heartbeat", **fields))
        self.listen("TIMESYNC", self.answer_time)
        self.done = threading.Event()

    def listen(self, name, callback):
        self.direct.subscribe_message(name, lambda message, _: callback(json.loads(message.fields_json)))

    def tell(self, event, **fields):
        print(json.dumps({"event": event, "at_s": time.monotonic(), **fields}), flush=True)

    def change_mode(self, mode):
        """Take HOLD too: the library leaves that one to the application."""
        self.tell("mode", mode=mode.name)
        if mode is FlightMode.HOLD:
            self.actions.set_flight_mode_internal(mode)

    def send(self, name, **fields):
        self.direct.send_message(MavlinkMessage(name, 1, 1, 0, 0, json.dumps(fields)))

    def answer_time(self, request):
        if request["tc1"] == 0:
            self.send("TIMESYNC", tc1=time.monotonic_ns(), ts1=request["ts1"])

    def fly(self):
        self.tell("up")
        while not self.done.wait(TELEMETRY_S):
            boot_ms = time.monotonic_ns() // 1_000_000
            still = {"rollspeed": 0, "pitchspeed": 0, "yawspeed": 0, "roll": 0, "pitch": 0, "yaw": 0}
            self.send("ATTITUDE", time_boot_ms=boot_ms, **still)
            motion = {"x": 3, "y": 4, "z": 0, "vx": 0.25, "vy": 0, "vz": 0}
            self.send("LOCAL_POSITION_NED", time_boot_ms=boot_ms, **motion)

    def operate(self):
        for line in sys.stdin:
            verb, *rest = line.split()
            if verb == "mode":
                self.actions.set_flight_mode_internal(FlightMode[rest[0]])
            elif verb == "disarm":
                self.actions.set_armed_state(False)
            elif verb == "quit":
                break
        self.done.set()


if __name__ == "__main__":
    autopilot = Autopilot(int(sys.argv[1]))
    threading.Thread(target=autopilot.operate, daemon=True).start()
    autopilot.fly()
