"""The firmware's end of the wire, and the world in which it drives."""
