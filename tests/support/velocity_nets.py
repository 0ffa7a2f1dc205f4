"""Velocity networks as other people build them in torch, and their ONNX exports."""

import warnings

import torch
from torch import nn

OBSERVATION = 7


class Mlp(nn.Module):
    """Concatenates inputs and time features, normalises the observation, two hidden layers."""

    def __init__(self, activation=nn.SiLU, width=16):
        super().__init__()
        torch.manual_seed(0)
        self.first = nn.Linear(OBSERVATION + 2 + 1 + 4, width)
        self.second = nn.Linear(width, width)
        self.last = nn.Linear(width, 2)
        self.activation = activation()
        self.register_buffer("frequency", torch.tensor([3.1, 6.2]))

    def features(self, action, tau, observation):
        angle = tau * self.frequency
        return torch.cat([(observation - 0.1) / 2, torch.sin(angle), action, torch.cos(angle), tau], -1)

    def forward(self, action, tau, observation):
        x = self.activation(self.first(self.features(action, tau, observation)))
        return self.last(self.activation(self.second(x)))


class Residual(Mlp):
    """A skip connection around the second layer."""

    def forward(self, action, tau, observation):
        x = self.activation(self.first(self.features(action, tau, observation)))
        return self.last(x + self.activation(self.second(x)))


class Normed(Mlp):
    """Layer normalisation and a gate that depends on the action."""

    def __init__(self, activation=nn.SiLU, width=16):
        super().__init__(activation, width)
        self.norm = nn.LayerNorm(width)
        nn.init.normal_(self.norm.weight)

    def forward(self, action, tau, observation):
        x = self.norm(self.first(self.features(action, tau, observation)))
        gate = torch.sigmoid(self.second(x)) / (1.5 - torch.tanh(x))
        return self.last(self.activation(x) * gate) - action * tau


class Attention(Mlp):
    """Self-attention: products of varying tensors, reshapes, softmax, reductions."""

    def forward(self, action, tau, observation):
        x = self.first(self.features(action, tau, observation)).reshape(-1, 4, 4)
        scores = torch.softmax(x @ x.transpose(1, 2) / 2, -1)
        mixed = torch.flatten(scores @ x, 1)
        low, high = mixed.split([8, 8], 1)
        spread = (high.pow(2).mean(1, keepdim=True) + 1).sqrt()
        return self.last(
            self.activation(self.second(torch.cat([low / spread, high.exp().sum(1)[:, None] * low], 1)))
        )


def export(net, path, names=("action", "tau", "observation"), batch=3, dynamic=True, **options):
    """Write ``net`` with torch's own exporter."""
    inputs = (torch.zeros(batch, 2), torch.zeros(batch, 1), torch.zeros(batch, OBSERVATION))
    axes = {name: {0: "n"} for name in (*names, "v")} if dynamic else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net.eval(),
            inputs,
            path,
            dynamo=False,
            input_names=list(names),
            output_names=["v"],
            dynamic_axes=axes,
            **options,
        )
    return path


def autograd(net, action, tau, observation):
    """Velocity (B, d) and Jacobian (B, d, d) of rows (B, d), (B, 1), (B, O)."""

    def one(a, t, o):
        return net(a[None], t[None], o[None])[0]

    jacobian = torch.func.vmap(torch.func.jacrev(one))(action, tau, observation)
    return net(action, tau, observation).detach().numpy(), jacobian.detach().numpy()
