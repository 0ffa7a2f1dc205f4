"""Frames between robots: their layout and seals, and the sockets and carriers that take them."""
