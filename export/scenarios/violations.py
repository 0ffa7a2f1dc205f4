"""How much robots violate execution objectives right now, by the costs that guide them at run time."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from edge_runtime.motion.model import Model
from edge_runtime.objectives import Objective
from export.evaluation.objectives import evaluate_batch
from export.evaluation.outlook import TeamBatch, look_ahead_batch


def violations(objectives: tuple[Objective, ...], model: Model, position: Tensor, velocity: Tensor) -> Tensor:
    """Bounded violations c / (1 + c), c = sqrt(2 J), of B teams of N robots.

    The runtime's cost J_m is half the squared action that would cure a violation, so c is that action, in
    newtons; the quotient never exceeds one and still tells a gross violation from a worse one.

    Args:
        objectives: M of them; each costs the motion as it is, however far it looks ahead.
        model: how the robots move; none of them turns.
        position: (B, N, 2) in metres.
        velocity: (B, N, 2) in m/s.

    Returns:
        (B, N, M) in [0, 1).
    """
    motion = [values.double().cpu().numpy() for values in (position, velocity)]
    team = TeamBatch.of_teams(*motion, np.zeros_like(motion[0]))
    costs = []
    for objective in objectives:
        ahead = look_ahead_batch(team, model.preview(objective.look_ahead))
        outlook = replace(ahead, drift=team.own, mates=team.mates)  # everybody where they are
        costs.append(evaluate_batch(objective, team.own, outlook).cost)
    cure = np.sqrt(2.0 * np.stack(costs, -1)).reshape(*position.shape[:2], -1)
    return torch.from_numpy(cure / (1.0 + cure)).to(position.device, position.dtype)
