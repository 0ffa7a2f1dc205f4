"""What weights stored in sixteen bits would bring, by width: ``python -m benchmarks latency --sixteen-bits``.

Compiles ``sixteen_bits.c`` for this processor: the kernel's own inner loop, with weights of 32 bits and of 16
that are widened when they are read. The sums have 32 bits in both.
"""

import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.common.result_page import table
from edge_runtime.errors import ConfigError

SOURCE = Path(__file__).with_suffix(".c")
COMPILE = ("gcc", "-O3", "-march=native", "-ffp-contract=fast", "-Wno-psabi", str(SOURCE))
WIDTHS = (64, 128, 256, 384, 512, 1024)
HEAD = ["layers", "rows", "32 bits us", "16 bits us", "times faster"]


def measure(widths: Sequence[int] = WIDTHS) -> str:
    """Return the table of two hidden layers' products in ten steps, best of 300.

    Raises:
        ConfigError: if there is no C compiler, or the processor does not widen 16 bits.
    """
    return table(HEAD, [cells for width in widths for cells in _rows(width)])


def _rows(width: int) -> list[list[str]]:
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "sixteen_bits"
        try:
            for command in ((*COMPILE, f"-DWIDTH={width}", "-o", program), (program,)):
                done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603
        except FileNotFoundError as error:
            raise ConfigError("gcc is not installed (Debian: apt-get install gcc)") from error
        except subprocess.CalledProcessError as error:
            raise ConfigError(f"{SOURCE.name}: {error.stderr.strip().splitlines()[-1]}") from error
    rows = []
    for line in done.stdout.splitlines():
        count, whole_us, half_us = line.split()
        times = float(whole_us) / float(half_us)
        rows.append([f"3x{width}", count, f"{float(whole_us):.1f}", f"{float(half_us):.1f}", f"{times:.2f}"])
    return rows
