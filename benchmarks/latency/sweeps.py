"""Which cases a full run times beside the default one: one size varied at a time."""

from collections.abc import Callable

import msgspec

from benchmarks.latency.cases import Case

CONTENDERS = ("eager", "onnx-step", "numpy", "compiled-own", "compiled")
"""Timed in every sweep; torch.compile and the unrolled graph take too long to prepare for each case."""


class Sweep(msgspec.Struct, frozen=True):
    """One size varied, all others as in the default case."""

    title: str
    symbol: str
    values: tuple[int, ...]
    make: Callable[[int], Case]


SWEEPS = (
    Sweep("steps T", "T", (1, 2, 5, 10, 15, 20), lambda T: Case(steps=T)),  # noqa: N803
    Sweep("objectives M", "M", tuple(range(1, 9)), lambda M: Case(objectives=M)),  # noqa: N803
    Sweep("neighbours K", "K", (0, 3, 7, 31), lambda K: Case(neighbours=K)),  # noqa: N803
    Sweep("batch (team of 8, S = 16 samples, team of 64)", "B", (1, 8, 16, 64), lambda B: Case(batch=B)),  # noqa: N803
    Sweep("hidden width (3 layers)", "H", (32, 64, 128, 256, 512), lambda H: Case(layers=(H,) * 3)),  # noqa: N803
)
