"""What strangers write, made up from a seed: bundles, TOML, logs, graphs, command lines.

Each module offers ``prepare(folder)``, and ``attempt(draw, given)``, which makes one case and puts it to use:
it returns, or raises an error of the family. `hostile.batch` holds cases to time and memory.
"""
