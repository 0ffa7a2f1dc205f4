"""The tick as research code writes it: modules, costs as functions, one backward pass per objective."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from benchmarks.latency.cases import Workload
from edge_runtime.motion.linear import PlanarPreview
from edge_runtime.objectives import Objective, SpeedLimit
from edge_runtime.policy.weights import FlowWeights

Cost = Callable[[Tensor], Tensor]


class VelocityNetwork(nn.Module):
    """v(a, tau | o) of `FlowWeights` from stock layers."""

    def __init__(self, weights: FlowWeights) -> None:
        super().__init__()
        first = [weights.action, weights.observation, weights.time]
        matrices = [
            torch.cat([torch.from_numpy(part) for part in first]),
            *map(torch.from_numpy, weights.matrices),
        ]
        layers: list[nn.Module] = []
        for matrix, bias in zip(matrices, weights.biases, strict=True):
            linear = nn.Linear(*matrix.shape)
            linear.weight.data, linear.bias.data = matrix.T.contiguous(), torch.from_numpy(bias)
            layers += [linear, nn.SiLU() if weights.activation == "silu" else nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self.register_buffer("frequency", torch.from_numpy(weights.time_frequency))
        self.register_buffer("phase", torch.from_numpy(weights.time_phase))
        self.prior_std = weights.prior_std

    def forward(self, action: Tensor, tau: Tensor, observation: Tensor) -> Tensor:
        """Velocity (B, d) of action (B, d) at flow time tau (B, 1) given observation (B, O)."""
        features = torch.cat([tau, torch.sin(tau * self.frequency + self.phase)], -1)
        velocity = self.network(torch.cat([action, observation, features], -1))
        if self.prior_std is None:
            return velocity
        variance = self.prior_std**2
        gain = (tau * variance - (1 - tau)) / ((1 - tau) ** 2 + tau**2 * variance)
        return velocity + gain * action


def make_costs(work: Workload) -> list[Cost]:
    """J_m as functions of the terminal estimate (B, d), summed over the batch."""
    own, mates = work.team.own, work.team.mates
    arrays = {
        "position_m": own.position_m,
        "velocity_m_s": own.velocity_m_s,
        "mate_position_m": mates.position_m,
        "mate_velocity_m_s": mates.velocity_m_s,
        "mate_action": work.team.mate_action,
    }
    team = {name: torch.from_numpy(values).float() for name, values in arrays.items()}
    guide = work.make_guide()
    return [_cost(o, preview, team) for o, preview in zip(guide.objectives, guide.previews, strict=True)]


def _cost(objective: Objective, preview: PlanarPreview, team: dict[str, Tensor]) -> Cost:
    def speed(action: Tensor) -> Tensor:
        velocity = preview.velocity_decay * team["velocity_m_s"] + preview.velocity_gain * action
        excess = torch.linalg.vector_norm(velocity, dim=-1) - objective.limit_m_s + objective.buffer_m_s
        return 0.5 * torch.square(torch.relu(excess) / preview.velocity_gain).sum()

    def margin(action: Tensor) -> Tensor:
        position = _position(team["position_m"], team["velocity_m_s"], action, preview)
        mates = _position(team["mate_position_m"], team["mate_velocity_m_s"], team["mate_action"], preview)
        distance = torch.linalg.vector_norm(position[:, None] - mates, dim=-1)
        shortfall = torch.relu(objective.distance_m + objective.buffer_m - distance)
        return 0.5 * torch.square(shortfall / preview.position_gain).sum()

    return speed if isinstance(objective, SpeedLimit) else margin


def _position(position: Tensor, velocity: Tensor, action: Tensor, preview: PlanarPreview) -> Tensor:
    return position + preview.position_decay * velocity + preview.position_gain * action


def project_away(vector: Tensor, other: Tensor) -> Tensor:
    """Remove from each row of ``vector`` (B, d) what opposes ``other``: the projection of eqs. 14 and 15."""
    dot = (vector * other).sum(-1, keepdim=True).clamp(max=0.0)
    return vector - dot / ((other * other).sum(-1, keepdim=True) + 1e-12) * other


def hierarchical(directions: list[Tensor], factors: tuple[float, ...], velocity: Tensor) -> Tensor:
    """Eqs. 14 and 15: M descent directions (B, d) -> guidance (B, d)."""
    total = torch.zeros_like(velocity)
    for m, direction in enumerate(directions):
        for n, other in enumerate(directions):
            if n != m:
                direction = project_away(direction, other)
        total = total + factors[m] * direction
    return project_away(total, velocity)


def eager_tick(
    network: VelocityNetwork,
    costs: list[Cost],
    factors: tuple[float, ...],
    steps: int,
    observation: Tensor,
    start: Tensor,
) -> Tensor:
    """T steps with one backward pass per objective and step: (B, O), (B, d) -> (B, d)."""
    action = start
    for k in range(steps):
        tau = torch.full((len(action), 1), k / steps)
        action = action.detach().requires_grad_(True)
        velocity = network(action, tau, observation)
        estimate = action + (1 - tau) * velocity
        directions = [-torch.autograd.grad(cost(estimate), action, retain_graph=True)[0] for cost in costs]
        velocity = velocity.detach()
        action = action.detach() + (velocity + hierarchical(directions, factors, velocity)) / steps
    return action
