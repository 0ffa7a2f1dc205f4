"""How much robots violate execution objectives right now, by the costs that guide them at run time."""

import numpy as np
import torch
from msgspec.structs import replace
from torch import Tensor

from edge_runtime.motion.dynamics import Dynamics, Preview
from edge_runtime.objectives import Objective
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import TeamBatch, look_ahead_batch


def violations(
    objectives: tuple[Objective, ...], dynamics: Dynamics, position: Tensor, velocity: Tensor
) -> Tensor:
    """Bounded violations c / (1 + c), c = sqrt(2 J), of B teams of N robots.

    The runtime's cost J_m is half the squared action that would cure a violation, so c is that action, in
    newtons; the quotient never exceeds one and still tells a gross violation from a worse one.

    Args:
        objectives: M of them; each costs the motion as it is, however far it looks ahead.
        dynamics: what an action does to the motion.
        position: (B, N, 2) in metres.
        velocity: (B, N, 2) in m/s.

    Returns:
        (B, N, M) in [0, 1).
    """
    motion = [values.double().cpu().numpy() for values in (position, velocity)]
    team = TeamBatch.of_teams(*motion, np.zeros_like(motion[0]))
    costs = []
    for objective in objectives:
        outlook = look_ahead_batch(team, _standing(dynamics.preview(objective.look_ahead)))
        costs.append(evaluate_batch(objective, team.own, outlook).cost)
    cure = np.sqrt(2.0 * np.stack(costs, -1)).reshape(*position.shape[:2], -1)
    return torch.from_numpy(cure / (1.0 + cure)).to(position.device, position.dtype)


def _standing(ahead: Preview) -> Preview:
    """A preview that leaves everybody where they are, with the gains that scale the costs."""
    return replace(ahead, velocity_decay=1.0, position_decay=0.0)
