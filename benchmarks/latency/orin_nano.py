"""One tick on a core of a Jetson Orin Nano, estimated by the kernel's own inner loop.

The kernel is compiled for that processor, and llvm-mca says how many cycles the loop takes in which its
arithmetic lies: the hidden layers' products, of all rows at once. It does so by its model of the Neoverse N1,
which issues two vector multiply-adds a cycle as the Cortex-A78AE does (Arm's Software Optimization Guide for
the A78); LLVM's cortex-a78 is the A57's model, which issues one.
"""

import re
import shutil
import subprocess
import sysconfig
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import msgspec

from benchmarks.latency.cases import DEFAULT, Case
from benchmarks.latency.limit import weight_bytes
from edge_runtime import policy
from edge_runtime.errors import ConfigError

CLOCK_HZ = 1.5e9
CACHE_BYTES_S = 12e9
"""Assumed: weights that do not fit the core's 256 KiB L2 are read from the shared L3 in every step."""
LANES, COLUMNS = 4, 4
"""Of the kernel's NEON pass: floats of a register, and registers of a block's row."""
OLDEST_LLVM = 17
"""The first whose Neoverse N1 is not the A57."""
ITERATIONS = 1000
TOOLS = "the estimate for a Jetson needs gcc-aarch64-linux-gnu and llvm-19 (Debian: apt-get install both)"


class Estimate(msgspec.Struct, frozen=True):
    """A tick's products, guidance and activations left out."""

    cycles: float
    """In which one input of a block is multiplied and added, in all rows."""
    arithmetic_us: float
    reading_us: float
    """For taking the weights from the L3 in every step."""


def estimate(case: Case = DEFAULT) -> Estimate:
    """Ask llvm-mca.

    Raises:
        ConfigError: if the compiler, Python's headers or llvm-mca are not there.
    """
    rows = 1 + case.action_dim
    cycles = _cycles_an_input(inner_loop(assembly(), rows), rows)
    inputs = case.steps * sum(a * -(-b // (LANES * COLUMNS)) for a, b in pairwise(case.layers))
    return Estimate(cycles, 1e6 * inputs * cycles / CLOCK_HZ, 1e6 * weight_bytes(case) / CACHE_BYTES_S)


def describe() -> str:
    """Say what one tick of the default case takes there, or why nobody can tell here."""
    try:
        found = estimate()
    except ConfigError as error:
        return f"{error}."
    arithmetic_us, reading_us = found.arithmetic_us, found.reading_us
    return (
        f"{max(arithmetic_us, reading_us):.0f} to {arithmetic_us + reading_us:.0f} µs for the default case's "
        "hidden layers; activations and guidance come on top. Not measured: by llvm-mca, the kernel's "
        f"inner loop takes {found.cycles:.2f} cycles an input, {arithmetic_us:.0f} µs in all at "
        f"{CLOCK_HZ / 1e9:g} GHz; reading the weights in every step takes {reading_us:.0f} µs if the L3 "
        f"cache gives {CACHE_BYTES_S / 1e9:g} GB/s (assumed), beside the arithmetic or after it. "
        "Run on the device, this command leaves the paragraph out."
    )


def assembly() -> str:
    """Compile the kernel for aarch64; raises as `estimate`."""
    flags = ("-O3", "-ffp-contract=fast", "-Wno-psabi", "-S", "-o", "-")
    headers = f"-I{sysconfig.get_path('include')}"
    return _run("aarch64-linux-gnu-gcc", *flags, headers, str(Path(policy.__file__).parent / "_kernel.c"))


def inner_loop(text: str, rows: int) -> list[str]:
    """Return the instructions of the product's innermost loop over so many rows.

    Raises:
        ConfigError: if there is none: the compiler has unrolled it otherwise.
    """
    for loop in inner_loops(text):
        sums = {line.split()[1] for line in loop if line.startswith("\tfmla\t")}
        if len(sums) == COLUMNS * rows:
            return loop
    raise ConfigError(f"the kernel for aarch64 has no loop over {rows} rows: compile it with Debian 12's gcc")


def inner_loops(text: str) -> Iterator[list[str]]:
    """Yield the instructions of each innermost loop of the product, from its label to the jump back."""
    body = text.partition("\nproduct_baseline:\n")[2].partition("\t.size\tproduct_baseline")[0]
    parts = re.split(r"(?m)^(\.L\d+):$", body)
    for label, code in zip(parts[1::2], parts[2::2], strict=True):
        lines = code.splitlines()
        for end, line in enumerate(lines):
            if re.fullmatch(rf"\t(?:b\w\w|cbnz\t\w+,)\s*{re.escape(label)}", line):
                yield [line for line in lines[: end + 1] if line and not line.startswith("\t.")]


def _cycles_an_input(loop: list[str], rows: int) -> float:
    inputs = sum(line.startswith("\tfmla\t") for line in loop) / (COLUMNS * rows)
    code = "\n".join(re.sub(r"\.L\d+", "0", line) for line in loop)
    flags = ("-mtriple=aarch64", "-mcpu=neoverse-n1", f"-iterations={ITERATIONS}")
    found = re.search(r"Total Cycles:\s+(\d+)", _run(_analyser(), *flags, code=code))
    if found is None:
        raise ConfigError("llvm-mca says no cycles")
    return int(found[1]) / ITERATIONS / inputs


def _analyser() -> str:
    """The name of an llvm-mca that knows the processor."""
    for name in ("llvm-mca", *(f"llvm-mca-{version}" for version in range(OLDEST_LLVM, 40))):
        if shutil.which(name):
            version = re.search(r"LLVM version (\d+)", _run(name, "--version"))
            if version and int(version[1]) >= OLDEST_LLVM:
                return name
    raise ConfigError(TOOLS)


def _run(*command: str, code: str = "") -> str:
    try:
        done = subprocess.run(command, input=code, capture_output=True, text=True, check=True)  # noqa: S603
    except FileNotFoundError as error:
        raise ConfigError(TOOLS) from error
    except subprocess.CalledProcessError as error:
        raise ConfigError(f"{command[0]}: {error.stderr.strip().splitlines()[-1]}") from error
    return done.stdout
