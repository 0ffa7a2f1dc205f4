"""What every part of the robot side shares: bounds, TOML, keys, child processes, signals, real time."""
