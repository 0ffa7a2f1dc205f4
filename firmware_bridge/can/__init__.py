"""CAN: profiles, codec, end-to-end protection, bus and the guard's link."""
