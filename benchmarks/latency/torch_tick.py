"""The whole tick as one traceable module without autograd, for torch.compile and for an unrolled ONNX graph.

The Jacobian is carried forward and the objectives' gradients are analytic, as in the runtime.
"""

import torch
from torch import Tensor, nn

from benchmarks.latency.cases import Workload
from benchmarks.latency.torch_eager import hierarchical
from edge_runtime.objectives import SpeedLimit
from edge_runtime.policy.weights import FlowWeights
from export.evaluation.outlook import look_ahead_batch


class Field(nn.Module):
    """The velocity field v(a, tau | o) of `FlowWeights`, layer by layer as the module docstring there."""

    def __init__(self, weights: FlowWeights) -> None:
        super().__init__()
        rows = torch.cat(
            [torch.from_numpy(part) for part in (weights.action, weights.observation, weights.time)]
        )
        matrices = [rows, *map(torch.from_numpy, weights.matrices)]
        self.matrices = nn.ParameterList(nn.Parameter(matrix, requires_grad=False) for matrix in matrices)
        biases = map(torch.from_numpy, weights.biases)
        self.biases = nn.ParameterList(nn.Parameter(bias, requires_grad=False) for bias in biases)
        self.register_buffer("frequency", torch.from_numpy(weights.time_frequency))
        self.register_buffer("phase", torch.from_numpy(weights.time_phase))
        self.prior_gain = weights.prior_gain
        self.silu = weights.activation == "silu"

    def inputs(self, action: Tensor, tau: float, observation: Tensor) -> Tensor:
        """Concatenate [a, o, phi(tau)]: (B, d), (B, O) -> (B, d + O + 1 + F)."""
        features = torch.sin(tau * self.frequency + self.phase).expand(len(action), -1)
        return torch.cat([action, observation, torch.full_like(action[:, :1], tau), features], 1)

    def with_tangents(self, action: Tensor, tau: float, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Velocity (B, d) and tangents dv/da_j (d, B, d), carried forward together."""
        d = action.shape[1]
        hidden = self.inputs(action, tau, observation)
        tangents = self.matrices[0][:d, None]
        for index, (weight, offset) in enumerate(zip(self.matrices[:-1], self.biases[:-1], strict=True)):
            before = torch.addmm(offset, hidden, weight)
            tangents = tangents @ weight if index else tangents
            if self.silu:
                gate = torch.sigmoid(before)
                hidden = before * gate
                tangents = tangents * (gate + hidden * (1 - gate))
            else:
                hidden = torch.tanh(before)
                tangents = tangents * (1 - hidden * hidden)
        gain = float(self.prior_gain(tau))
        velocity = torch.addmm(self.biases[-1], hidden, self.matrices[-1]) + gain * action
        return velocity, tangents @ self.matrices[-1] + gain * torch.eye(d)[:, None]


class Objectives(nn.Module):
    """The workload's costs by their gradients."""

    def __init__(self, workload: Workload) -> None:
        super().__init__()
        guide = workload.make_guide()
        self.factors = guide.factors
        self.terms = []
        for objective, preview in zip(guide.objectives, guide.previews, strict=True):
            outlook = look_ahead_batch(workload.team, preview)
            if isinstance(objective, SpeedLimit):
                limit = objective.limit_m_s - objective.buffer_m_s
                drift = torch.from_numpy(outlook.drift.velocity_m_s).float()
                self.terms.append((True, preview.velocity_gain, limit, drift, None))
            else:
                keep = objective.distance_m + objective.buffer_m
                drift = torch.from_numpy(outlook.drift.position_m).float()
                mates = torch.from_numpy(outlook.mates.position_m).float()
                self.terms.append((False, preview.position_gain, keep, drift, mates))

    def gradients(self, estimate: Tensor) -> list[Tensor]:
        """Analytic gradients dJ_m/da_hat, each (B, d), for two action components."""
        gradients = []
        for is_speed, gain, limit, drift, mates in self.terms:
            motion = drift + gain * estimate
            if is_speed:
                norm = torch.sqrt((motion * motion).sum(-1, keepdim=True))
                gradients.append(torch.relu(norm - limit) / (gain * norm) * motion)
            else:
                apart = motion[:, None] - mates
                norm = torch.sqrt((apart * apart).sum(-1, keepdim=True))
                gradients.append(-(torch.relu(limit - norm) / (gain * norm) * apart).sum(1))
        return gradients


class FusedTick(nn.Module):
    """The whole tick as one graph without autograd."""

    def __init__(self, workload: Workload) -> None:
        super().__init__()
        self.field, self.objectives = Field(workload.weights), Objectives(workload)
        self.steps = workload.case.steps

    def forward(self, observation: Tensor, start: Tensor) -> Tensor:
        """(B, O), (B, d) -> (B, d)."""
        action = start
        for k in range(self.steps):
            left = 1 - k / self.steps
            velocity, tangents = self.field.with_tangents(action, k / self.steps, observation)
            directions = [
                -gradient - left * torch.einsum("jbi,bi->bj", tangents, gradient)
                for gradient in self.objectives.gradients(action + left * velocity)
            ]
            guidance = hierarchical(directions, self.objectives.factors, velocity)
            action = action + (velocity + guidance) / self.steps
        return action
