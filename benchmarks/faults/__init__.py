"""Faults while a robot drives, timed at the firmware's end of the wire."""
