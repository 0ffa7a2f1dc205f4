"""The samples of VMAS Sampling as tensors: three bumps over a grid of cells, each cell counting once.

Computes what ``vmas.scenarios.sampling`` 1.5.2 computes, for all teams and robots at once; the bumps are
separable, so a window of cells around a robot costs one exponential per row and column instead of one per
cell.
"""

import torch
from torch import Tensor

from export.beliefs.field_guesses import BUMPS, HALF_WIDTH_M, VARIANCE_M2
from export.beliefs.sample_belief import CELL_M, CELLS
from export.scenarios.vmas_teams import State


class SampleField:
    """What is left to sample in B teams' fields.

    Args:
        environments: B.
        wall_m: positions are clamped to a square of this half-width before they are looked up.
        device: where all tensors lie.
    """

    def __init__(self, environments: int, wall_m: float, device: torch.device) -> None:
        self.centre = torch.zeros(environments, BUMPS, 2, device=device)
        self.densest = torch.ones(environments, device=device)
        """(B,) the greatest density at a corner of a cell: a sample's value is relative to it."""
        self.emptied = torch.zeros(environments, CELLS**2, dtype=torch.bool, device=device)
        self._wall = wall_m
        corner = torch.arange(-HALF_WIDTH_M, HALF_WIDTH_M, CELL_M, device=device).clamp(-wall_m, wall_m)
        self._corners = corner[:, None].expand(-1, 2)
        self._window = torch.tensor([-CELL_M, 0.0, CELL_M], device=device)

    def untouched(self, centre: Tensor) -> State:
        """Return the state of R fields that nobody has visited, with bumps at ``centre`` (R, 3, 2)."""
        return {
            "centre": centre,
            "emptied": self.emptied.new_zeros(len(centre), CELLS**2),
            "densest": _density(self._corners.expand(len(centre), 1, -1, -1), centre).amax((1, 2, 3)),
        }

    def state(self) -> State:
        """Return copies of what tells B fields apart."""
        return {name: getattr(self, name).clone() for name in ("centre", "densest", "emptied")}

    def set_state(self, state: State) -> None:
        """Continue from what ``state`` returned."""
        for name in self.state():
            getattr(self, name).copy_(state[name])

    def around(self, position: Tensor) -> Tensor:
        """Return the values (B, N, 3, 3) one cell to either side of ``position`` (B, N, 2), by x, then y."""
        value, _ = self._look_up(position[:, :, None] + self._window[:, None])
        return value

    def collect(self, position: Tensor) -> Tensor:
        """Return the values (B, N) at ``position`` (B, N, 2) and empty those cells.

        Of several robots in one cell the first takes the sample.
        """
        value, cell = (x[..., 0, 0] for x in self._look_up(position[:, :, None]))
        taken = (cell[:, :, None] == cell[:, None]).tril(-1).any(-1)
        self.emptied.scatter_(1, cell, True)
        return value.masked_fill_(taken, 0.0)

    def _look_up(self, point: Tensor) -> tuple[Tensor, Tensor]:
        """Values and cells (B, N, W, W) at all pairs of the coordinates in ``point`` (B, N, W, 2)."""
        outside = (point.abs() > HALF_WIDTH_M).unbind(-1)
        point = point.clamp(-self._wall, self._wall)
        row, column = (point / CELL_M + CELLS / 2).long().unbind(-1)
        cell = row[..., None] * CELLS + column[..., None, :]
        empty = self.emptied.gather(1, cell.flatten(1)).view(cell.shape)
        empty |= outside[0][..., None] | outside[1][..., None, :]
        value = _density(point, self.centre) / self.densest[:, None, None, None]
        return value.masked_fill_(empty, 0.0), cell


def _density(point: Tensor, centre: Tensor) -> Tensor:
    """Sum of the bumps around ``centre`` (B, 3, 2) at ``point`` (B, N, W, 2), by x, then y: (B, N, W, W)."""
    factor = ((point[..., None, :] - centre[:, None, None]).square_() / (-2 * VARIANCE_M2)).exp_()
    along_x, along_y = factor.unbind(-1)
    return along_x @ along_y.mT
