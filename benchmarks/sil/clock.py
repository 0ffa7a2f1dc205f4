"""A wall clock for one run and its processes, so that it may jump and the machine's need not.

Only what the processes see of it: see ``clock.c``, which is compiled and preloaded.
"""

import subprocess
from pathlib import Path

from edge_runtime.errors import BridgeError

SOURCE = Path(__file__).with_suffix(".c")


def own_clock(folder: Path) -> dict[str, str]:
    """Compile what processes must preload; returns the environment of those that share one clock.

    Raises:
        BridgeError: if there is no C compiler, or it does not take the source.
    """
    library = folder / "clock.so"
    command = ["cc", "-shared", "-fPIC", "-O2", "-Wall", "-Wextra", "-o", str(library), str(SOURCE), "-ldl"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own
    except OSError as error:
        raise BridgeError(f"a clock that jumps needs a C compiler ({error.strerror})") from error
    if done.returncode:
        raise BridgeError(f"{SOURCE.name} does not compile: {done.stderr.strip().splitlines()[-1]}")
    return {"LD_PRELOAD": str(library), "WALL_CLOCK": str(folder / "wall_clock")}
