import torch
from torch.distributions import Normal

from export.algorithms.mafpo_chain import MafpoChain


def algorithm_with_weights():
    torch.manual_seed(0)
    algorithm = MafpoChain(18, 2)
    for parameter in algorithm.actor.parameters():
        parameter.data.add_(0.1 * torch.randn_like(parameter))
    return algorithm


def test_log_likelihood_is_the_density_of_the_chains_transitions():
    algorithm = algorithm_with_weights()
    algorithm.half_precision = False
    observation = torch.randn(32, 18)
    action, trace = algorithm.explore(observation, torch.Generator().manual_seed(0))
    chain, steps, sigma = trace.view(32, 11, 2), 10, algorithm.actor.log_step_noise.exp()
    density = torch.zeros(32)
    for k in range(steps):
        velocity = algorithm.actor.flow(chain[:, k], torch.full((32, 1), k / steps), observation)
        density += Normal(chain[:, k] + velocity / steps, sigma).log_prob(chain[:, k + 1]).sum(-1)
    constant = steps * Normal(torch.zeros(2), 1.0).log_prob(torch.zeros(2)).sum()
    torch.testing.assert_close(algorithm.log_likelihood(observation, action, trace), density - constant)
    assert torch.equal(chain[:, -1], action)


def test_half_precision_moves_a_log_likelihood_by_far_less_than_an_update_does():
    algorithm = algorithm_with_weights()
    observation = torch.randn(512, 18)
    samples = (observation, *algorithm.explore(observation, torch.Generator().manual_seed(0)))
    half = algorithm.log_likelihood(*samples)
    algorithm.half_precision = False
    assert (half - algorithm.log_likelihood(*samples)).abs().mean() < 0.02


def test_without_step_noise_it_explores_as_deployed():
    algorithm = algorithm_with_weights()
    algorithm.actor.log_step_noise.data.fill_(-torch.inf)
    observation = torch.randn(32, 18)
    action, trace = algorithm.explore(observation, torch.Generator().manual_seed(0))
    torch.testing.assert_close(action, algorithm.act(observation, trace[:, :2]))


def test_clip_stops_the_gradient_outside_the_trust_region_only():
    algorithm = MafpoChain(2, 2)
    ratio = torch.tensor([0.5, 0.9, 1.1, 1.5, 0.5, 0.9, 1.1, 1.5], requires_grad=True)
    advantage = torch.tensor([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    (gradient,) = torch.autograd.grad(algorithm.objective(ratio, advantage).sum(), ratio)
    assert gradient.tolist() == [1.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, -1.0]
