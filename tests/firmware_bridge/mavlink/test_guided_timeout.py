"""The script that gives a Rover a command timeout, in a Lua of its own, with the functions it uses."""

import struct
from pathlib import Path

import pytest

import firmware_bridge.mavlink as mavlink
from firmware_bridge.mavlink.profiles import PROFILES

lua = pytest.importorskip("lupa.lua53", reason="lupa is not installed: pip install lupa")

GUIDED, HOLD, MANUAL = 15, 4, 0
SETPOINT, ATTITUDE = 84, 30
STEP_MS = 20
STUBS = """
function stubs(rover)
  local function milliseconds(value)
    return setmetatable({ value = value }, {
      __sub = function(a, b) return milliseconds(a.value - b.value) end,
      __index = { tofloat = function(self) return self.value end },
    })
  end
  millis = function() return milliseconds(rover.now_ms) end
  param = {
    add_table = function(_, key, prefix, count) return key > 0 and prefix == "GUID_" and count == 1 end,
    add_param = function(_, key, index, name, value)
      rover.parameter, rover.default = "GUID_" .. name, value
      return index == 1
    end,
  }
  Parameter = function(name)
    return { get = function() return name == rover.parameter and rover.default or nil end }
  end
  mavlink = {
    init = function(_, queue, ids) assert(queue > 0 and ids == 1) end,
    register_rx_msgid = function(_, id) rover.listens = id end,
    receive_chan = function() return rover.take() end,
  }
  vehicle = {
    get_mode = function() return rover.mode end,
    set_mode = function(_, mode) rover.mode = mode end,
  }
  arming = { is_armed = function() return rover.armed end }
  gcs = { send_text = function(_, severity, text) rover.said = text end }
end
"""


def frame(number):
    """As ArduPilot hands it to a script: checksum, magic, length, two flags, sequence, sender, number."""
    return struct.pack("<HBBBBBBBHB", 0, 0xFD, 0, 0, 0, 0, 255, 191, number, 0)


class Rover:
    """Runs the script every 20 ms, as its own answer asks for."""

    def __init__(self):
        self.now_ms, self.mode, self.armed = 5000.0, GUIDED, True
        self.parameter = self.default = self.listens = self.said = None
        self.queue = []
        runtime = lua.LuaRuntime(encoding=None)
        script = Path(mavlink.__file__).with_name("guided_timeout.lua").read_bytes()
        runtime.execute(STUBS)
        runtime.globals().stubs(self)
        self.update, step_ms = runtime.execute(script)
        assert step_ms == STEP_MS

    def take(self):
        return self.queue.pop(0) if self.queue else None

    def run(self, seconds, number=None):
        for _ in range(round(seconds * 1e3 / STEP_MS)):
            self.now_ms += STEP_MS
            if number is not None:
                self.queue.append(frame(number))
            self.update, _ = self.update()


@pytest.fixture
def rover():
    return Rover()


def test_it_tells_the_profiles_parameter(rover):
    assert rover.parameter.decode() == PROFILES["ardupilot_rover"].timeout_parameter
    assert (rover.default, rover.listens) == (0.5, SETPOINT)


def test_it_holds_once_setpoints_have_ended(rover):
    rover.run(3.0, SETPOINT)
    assert rover.mode == GUIDED
    rover.run(0.5)
    assert rover.mode == GUIDED
    rover.run(0.04)
    assert (rover.mode, rover.said) == (HOLD, b"no setpoint within GUID_TIMEOUT: HOLD")


def test_other_messages_are_no_setpoints(rover):
    rover.run(0.2, SETPOINT)
    rover.run(0.6, ATTITUDE)
    assert rover.mode == HOLD


def test_without_a_setpoint_it_leaves_guided_alone(rover):
    """Somebody drives to a waypoint by hand."""
    rover.run(10.0)
    assert (rover.mode, rover.said) == (GUIDED, None)


@pytest.mark.parametrize(("mode", "armed"), [(MANUAL, True), (HOLD, True), (GUIDED, False)])
def test_only_an_armed_rover_in_guided_is_its_business(rover, mode, armed):
    rover.run(0.2, SETPOINT)
    rover.mode, rover.armed = mode, armed
    rover.run(2.0)
    assert (rover.mode, rover.said) == (mode, None)
    rover.mode, rover.armed = GUIDED, True
    rover.run(2.0)
    assert rover.mode == GUIDED, "what was heard before counts no more"
