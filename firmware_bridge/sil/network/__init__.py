"""A network with faults between the robots' own sockets, and whoever attacks it."""
