-- Gives an ArduPilot Rover a command timeout: GUID_TIMEOUT seconds (0.5) without a setpoint in GUIDED, and it
-- changes to HOLD. Without this script every release drives on for three seconds (Rover/mode_guided.cpp).
--
-- Copy it to APM/scripts on the autopilot's card, set SCR_ENABLE to 1 and restart. No other script there may
-- read MAVLink messages: they would take them from each other. Tried with ArduPilot 4.7.

local PARAMETERS, GUIDED, HOLD, SET_POSITION_TARGET_LOCAL_NED = 71, 15, 4, 84
local WARNING, STEP_MS, MESSAGE_NUMBER_BYTE = 4, 20, 10

assert(param:add_table(PARAMETERS, "GUID_", 1), "parameter table 71 is in use")
assert(param:add_param(PARAMETERS, 1, "TIMEOUT", 0.5), "GUID_TIMEOUT")
local timeout = Parameter("GUID_TIMEOUT")

mavlink:init(20, 1)
mavlink:register_rx_msgid(SET_POSITION_TARGET_LOCAL_NED)

local heard_ms = nil

local function receive()
  local message = mavlink:receive_chan()
  while message do
    if string.unpack("<I3", message, MESSAGE_NUMBER_BYTE) == SET_POSITION_TARGET_LOCAL_NED then
      heard_ms = millis()
    end
    message = mavlink:receive_chan()
  end
end

function update()
  receive()
  if vehicle:get_mode() ~= GUIDED or not arming:is_armed() then
    heard_ms = nil
  elseif heard_ms and (millis() - heard_ms):tofloat() > 1000 * timeout:get() then
    heard_ms = nil
    vehicle:set_mode(HOLD)
    gcs:send_text(WARNING, "no setpoint within GUID_TIMEOUT: HOLD")
  end
  return update, STEP_MS
end

return update()
