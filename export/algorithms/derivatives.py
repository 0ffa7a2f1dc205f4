"""What a network computes and how that changes with the action: the truth for policies trained here."""

import copy

import torch
from torch import Tensor, nn

from edge_runtime.common.arrays import Floats
from export.bundle.parity import Inputs


def evaluate_torch(network: nn.Module, inputs: Inputs) -> Floats:
    """Velocity and autograd derivatives (1 + d, B, d) of ``network(action, tau (B, 1), observation)``.

    In double precision: the source's own rounding is not what the other forms are held to.
    """
    network = copy.deepcopy(network).double()
    action, tau, observation = (
        torch.tensor(array, dtype=torch.float64)
        for array in (inputs.action, inputs.tau[:, None], inputs.observation)
    )
    action.requires_grad_()
    velocity: Tensor = network(action, tau, observation)
    rows = [
        torch.autograd.grad(velocity[:, i].sum(), action, retain_graph=True)[0]
        for i in range(velocity.shape[1])
    ]
    jacobian = torch.stack(rows, dim=-1).permute(1, 0, 2)
    return torch.cat([velocity[None], jacobian]).detach().numpy()
