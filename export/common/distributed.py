"""Data-parallel workers under torchrun's conventions; a single worker needs no process group."""

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.distributed.launcher.api import LaunchConfig, elastic_launch

Value = TypeVar("Value")
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Workers:
    """This process among ``count`` that train one policy together."""

    rank: int = 0
    count: int = 1
    device: torch.device = CPU

    @property
    def leads(self) -> bool:
        """Whether this worker writes files and shows progress."""
        return self.rank == 0

    def mean(self, value: Tensor) -> Tensor:
        """Average a tensor over the workers, which must hold equally many samples each."""
        if self.count == 1:
            return value
        total = value.clone()
        dist.all_reduce(total)
        return total / self.count

    def average_gradients(self, parameters: Iterable[nn.Parameter]) -> None:
        """Average the gradients over the workers, in one message."""
        if self.count == 1:
            return
        gradients = [p.grad for p in parameters if p.grad is not None]
        mean = self.mean(torch.cat([g.flatten() for g in gradients]))
        for gradient, part in zip(gradients, mean.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))

    def gather(self, value: Value) -> list[Value]:
        """Return every worker's value, in order of rank."""
        if self.count == 1:
            return [value]
        values = [value] * self.count
        dist.all_gather_object(values, value)
        return values


@contextlib.contextmanager
def join() -> Iterator[Workers]:
    """Take this process's place in the group that torchrun announced; alone if it announced none."""
    rank, count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
    device = CPU
    if torch.cuda.is_available():
        device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
        torch.cuda.set_device(device)
    if count == 1:
        yield Workers(device=device)
        return
    dist.init_process_group("nccl" if device.type == "cuda" else "gloo")
    try:
        yield Workers(rank, count, device)
    finally:
        dist.destroy_process_group()


def launch(count: int, function: Callable[..., Value], *arguments: object) -> dict[int, Value]:
    """Run ``function(*arguments)`` in ``count`` processes of this machine, as ``torchrun`` would.

    Returns:
        What each worker returned, by rank.

    Raises:
        torch.distributed.elastic.multiprocessing.errors.ChildFailedError: if a worker fails.
    """
    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=count,
        run_id="edge-train",
        rdzv_backend="c10d",
        rdzv_endpoint="localhost:0",
        max_restarts=0,
    )
    return elastic_launch(config, function)(*arguments)
