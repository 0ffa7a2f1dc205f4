"""The guard: the process that owns the bus, and the runtime's side of its socket."""
