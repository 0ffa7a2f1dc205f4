"""Eqs. 10 to 15 in float64 PyTorch with autograd, written from the paper and independent of the runtime."""

import itertools
import math

import scipy.integrate
import scipy.optimize
import torch
import torch.nn.functional as F  # noqa: N812
from torch_rollout import rolled_out, tensor

from edge_runtime.messages import RobotState


def velocity(weights, action, tau, observation):
    """v_theta for one action (d,) as a differentiable tensor."""

    activation = F.silu if weights.activation == "silu" else torch.tanh
    features = torch.cat(
        [
            torch.tensor([tau], dtype=torch.float64),
            torch.sin(tau * tensor(weights.time_frequency) + tensor(weights.time_phase)),
        ]
    )
    inputs = torch.cat([action, tensor(observation), features])
    first = torch.cat([tensor(weights.action), tensor(weights.observation), tensor(weights.time)])
    hidden = activation(inputs @ first + tensor(weights.biases[0]))
    for matrix, bias in zip(weights.matrices[:-1], weights.biases[1:-1], strict=True):
        hidden = activation(hidden @ tensor(matrix) + tensor(bias))
    result = hidden @ tensor(weights.matrices[-1]) + tensor(weights.biases[-1])
    if weights.prior_std is not None:
        s2 = weights.prior_std**2
        result = result + (tau * s2 - (1 - tau)) / ((1 - tau) ** 2 + tau**2 * s2) * action
    return result


def gain(model, steps, which):
    """How far a unit action moves the predicted position (0) or velocity (1) of a robot at rest, at most."""
    rest = RobotState(0, 0.0, (0.0,) * model.dims, (0.0,) * model.dims)
    jacobian = torch.autograd.functional.jacobian(
        lambda action: rolled_out(model, rest, action, steps)[which], tensor([0.0] * model.action_dim)
    )
    return torch.linalg.matrix_norm(jacobian, 2).item()


def speed_cost(objective, team, model, action):
    speed = rolled_out(model, team.own, action, objective.look_ahead)[1]
    excess = speed.norm() - objective.limit_m_s + objective.buffer_m_s
    return 0.5 * (excess.clamp_min(0) / gain(model, objective.look_ahead, 1)) ** 2


def margin_cost(objective, team, model, action):
    position = rolled_out(model, team.own, action, objective.look_ahead)[0]
    scale, total = gain(model, objective.look_ahead, 0), torch.zeros((), dtype=torch.float64)
    for mate in team.teammates:
        distance = (position - _ahead(mate, model, objective)).norm()
        short = objective.distance_m + objective.buffer_m - distance
        total = total + 0.5 * (short.clamp_min(0) / scale) ** 2
    return total


def spacing_cost(objective, team, model, action):
    position = rolled_out(model, team.own, action, objective.look_ahead)[0]
    nearest = min((position - _ahead(mate, model, objective)).norm() for mate in team.teammates)
    return 0.5 * ((nearest - objective.distance_m) / gain(model, objective.look_ahead, 0)) ** 2


def order_cost(objective, team, model, action):
    position = rolled_out(model, team.own, action, objective.look_ahead)[0]
    scale, total = gain(model, objective.look_ahead, 0), torch.zeros((), dtype=torch.float64)
    own = objective.order.index(team.own.robot_id)
    for mate in team.teammates:
        ahead = _ahead(mate, model, objective)[0] - position[0]
        if objective.order.index(mate.state.robot_id) < own:
            ahead = -ahead
        cure = (objective.gap_m - ahead).clamp_min(0) / scale
        total = total + F.huber_loss(cure, torch.zeros_like(cure), delta=objective.pull)
    return total


def _ahead(mate, model, objective):
    return rolled_out(model, mate.state, tensor(mate.intended_action), objective.look_ahead)[0]


def combine(mode, gradients, weights, nominal):
    """Eqs. 14 and 15 as the paper states them; the cone by Moreau's theorem and least squares."""
    total = sum(w * g for w, g in zip(weights, gradients, strict=True))
    if mode == "none":
        return total
    if mode == "cone":
        matrix = torch.stack(gradients).numpy()
        multipliers, _ = scipy.optimize.nnls(matrix.T, -total.numpy())
        return total + torch.tensor(multipliers @ matrix)
    return nominal_projection(harmonized_sum(gradients, weights), nominal)


def harmonized_sum(gradients, weights):
    total = torch.zeros_like(gradients[0])
    for m, g in enumerate(gradients):
        for n, other in enumerate(gradients):
            if n != m and torch.dot(g, other) < 0:
                g = g - torch.dot(g, other) / torch.dot(other, other) * other
        total = total + weights[m] * g
    return total


def nominal_projection(total, nominal):
    if torch.dot(total, nominal) < 0:
        total = total - torch.dot(total, nominal) / torch.dot(nominal, nominal) * nominal
    return total


def guided_action(
    weights,
    observation,
    costs,
    lambdas,
    eta,
    mode,
    start,
    steps,
    wishes=(),
    reach=0.0,
    sampler="euler",
    most=5,
):
    """T steps of eq. 10; ``costs`` are differentiable functions of the terminal estimate.

    ``wishes`` are the places of those costs that the correction at tau = 1 takes for preferences, ``most``
    the steps that it takes for the others.
    """
    action, past = torch.tensor(start, dtype=torch.float64), []
    for tau, end in flow_times(sampler, steps):
        action = action.detach().requires_grad_(True)
        v = velocity(weights, action, tau, observation)
        estimate = action + (1 - tau) * v
        gradients = [-torch.autograd.grad(cost(estimate), action, retain_graph=True)[0] for cost in costs]
        v = v.detach()
        steered = gradients and mode != "correction"
        guidance = eta * combine(mode, gradients, lambdas, v) if steered else torch.zeros_like(v)
        if sampler == "euler":
            action = action.detach() + (end - tau) * (v + guidance)
        else:
            action = exponential_step(weights.prior_std, tau, end, action.detach(), v, guidance, past)
    if mode in ("terminal", "correction"):
        weighted = [(costs[m], lambdas[m]) for m in wishes]
        action = preferred(weighted, action, reach) if weighted else action
        musts = [cost for m, cost in enumerate(costs) if m not in wishes]
        action = required(musts, action, most) if musts else action
    return action.detach().numpy()


def flow_times(sampler, steps):
    """Beginning and end of each step: equal ones, or ends that approach 1 with the square of what is left."""
    left = [1 - k / steps for k in range(steps + 1)]
    times = [1 - share if sampler == "euler" else 1 - share * share for share in left]
    return list(itertools.pairwise(times))


def exponential_step(std, x, y, action, velocity, guidance, past):
    """The exact solution of a' = k(t) a + N, by quadrature, N on the line through this step's and the last.

    ``past`` holds (x, N) of the steps before, and takes this one's.
    """

    def k(t):
        return (t * std**2 - 1 + t) / ((1 - t) ** 2 + t**2 * std**2) if std else 0.0

    def grown(t):
        return math.exp(scipy.integrate.quad(k, t, y, epsabs=1e-12)[0])

    network = velocity - k(x) * action
    middle = network
    if past:
        before, last = past[-1]
        middle = network + (network - last) / (x - before) * (y - x) / 2
    past.append((x, network))
    return grown(x) * action + scipy.integrate.quad(grown, x, y, epsabs=1e-12)[0] * (middle + guidance)


def preferred(weighted_costs, finished, reach):
    """Five projected gradient steps of rate 1/2 on the weighted sum, in the ball around what was sampled."""
    action = finished
    for _ in range(5):
        action = action.detach().requires_grad_(True)
        total = sum(weight * cost(action) for cost, weight in weighted_costs)
        moved = action.detach() - 0.5 * torch.autograd.grad(total, action)[0] - finished
        action = finished + (moved if moved.norm() <= reach else reach * F.normalize(moved, dim=0))
    return action


def required(costs, action, most):
    """The best of so many: the cone's step, then the most violated cost's, in the corner of two."""
    action = action.detach().requires_grad_(True)
    downhill = [-torch.autograd.grad(cost(action), action)[0] for cost in costs]
    action = action.detach() + combine("cone", downhill, [1.0] * len(costs), torch.zeros_like(action))
    tried, last, place = [], None, None
    for _ in range(most):
        action = action.detach().requires_grad_(True)
        values = [cost(action) for cost in costs]
        tried.append((sum(value.item() for value in values), action.detach()))
        violated = [n for n, value in enumerate(values) if value.item() > 1e-18]
        if not violated:
            break
        place = max([n for n in violated if n != place] or violated, key=lambda n: values[n].item())
        downhill = -torch.autograd.grad(values[place], action)[0]
        step = downhill
        if last is not None and torch.dot(downhill, last) < 0.0:
            # The point at which both linear parts are met, in the plane of the two.
            plane = torch.stack([downhill, last])
            if torch.linalg.det(plane @ plane.T) > 0.01 * downhill.dot(downhill) * last.dot(last):
                met = torch.stack([downhill.dot(downhill), torch.zeros((), dtype=torch.float64)])
                step = torch.linalg.lstsq(plane, met[:, None], driver="gelsd").solution[:, 0]
        action, last = action.detach() + step, downhill
    return min(tried, key=lambda each: each[0])[1]
