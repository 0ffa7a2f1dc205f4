"""Cases of one kind, one after the other, each within its time and memory: a process of its own.

``python -m hostile.batch logs 17 1 FOLDER`` makes case 17 of ``hostile.logs`` again.
"""

import importlib
import random
import resource
import signal
import sys
import warnings
from pathlib import Path

from edge_runtime.errors import EdgeError

CPU_S = 5.0
MEMORY_MIB = 300
"""Resident, of the process and of every one that it starts."""
ADDRESSES = 4 << 30
"""Bytes of address space: what a runaway case meets before the machine does."""


def main(kind, first, count, folder):
    module = importlib.import_module(f"hostile.{kind}")
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    given = module.prepare(Path(folder))
    for case in range(int(first), int(first) + int(count)):
        print(f"case {case}", flush=True)
        signal.setitimer(signal.ITIMER_PROF, CPU_S)  # ends the process
        try:
            module.attempt(random.Random(case), given)
        except EdgeError as error:
            told = str(error)
            assert told.strip(), "an error that says nothing"
            assert "\n" not in told, told
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        check_memory(getattr(module, "MEMORY_MIB", MEMORY_MIB))
    print("done", flush=True)


def check_memory(most_mib):
    # Not ru_maxrss of this process: it counts what the process that started it held before exec.
    own = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")
    )
    for taken_kib in (int(own.split()[1]), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss):
        assert taken_kib < most_mib * 1024, f"took {taken_kib / 1024:.0f} MiB"


if __name__ == "__main__":
    main(*sys.argv[1:])
