"""MAVLink 2: codec, signing, transport, one autopilot and the guard's link to it."""
