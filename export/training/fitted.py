"""States from files: taken up only where they are made as this version's own are."""

from typing import Final, TypeVar, cast

import torch
from torch import Tensor

State = TypeVar("State")
LARGEST: Final = 1e12
"""Of any number in a state: far beyond what training reaches, far from overflow in float32."""
NEVER_NEGATIVE: Final = frozenset({"clock", "count", "exp_avg_sq", "n_averaged", "step", "variance"})
"""Counts and means of squares, as torch and this package name them."""


def fitted(found: object, own: State, name: str = "state") -> State:
    """Copy a state whose keys, types, shapes and kinds of numbers are those of another.

    Args:
        found: from a file; may be anything.
        own: a state as it is made here, of dicts, tensors and plain values.
        name: what ``found`` is the value of.

    Returns:
        Like ``own``; its tensors lie on the CPU, and share nothing with each other or with ``found``.

    Raises:
        ValueError: names what is missing, of another kind, not finite, or beyond all measure.
    """
    taken: object = found
    if isinstance(own, dict):
        if not isinstance(found, dict) or found.keys() != own.keys():
            raise ValueError(f"{name} has other keys")
        taken = {key: fitted(found[key], value, str(key)) for key, value in own.items()}
    elif isinstance(own, Tensor):
        taken = _tensor(found, own, name)
    elif type(found) is not type(own) or (isinstance(found, float) and not abs(found) <= LARGEST):
        raise ValueError(f"{name} is of another kind, or no number")
    return cast("State", taken)


def require_finite(*computed: Tensor) -> None:
    """Refuse weights that make no numbers of what they are given.

    Raises:
        ValueError: if anything that was computed with them is not finite.
    """
    if not all(bool(each.isfinite().all()) for each in computed):
        raise ValueError("its weights compute what is no finite number")


def _tensor(found: object, own: Tensor, name: str) -> Tensor:
    if not isinstance(found, Tensor) or found.is_nested or found.layout != torch.strided:
        raise ValueError(f"{name} is no plain tensor")
    if (found.dtype, found.shape, found.device.type) != (own.dtype, own.shape, "cpu"):
        raise ValueError(f"{name} is of another type or shape")
    values = found.detach().clone(memory_format=torch.contiguous_format)
    least = 0.0 if name.rpartition(".")[2] in NEVER_NEGATIVE else -LARGEST
    if not ((values >= least) & (values <= LARGEST)).all():  # NaN is neither
        raise ValueError(f"{name} holds what is no number, or beyond all measure")
    return values
