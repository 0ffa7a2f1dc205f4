import torch

from export.algorithms.moments import RunningMoments
from export.common.distributed import Workers


def test_batches_of_any_size_add_up_to_all_samples():
    samples = torch.randn(500, 3, dtype=torch.float64) * torch.tensor([1.0, 5.0, 0.1]) + 40
    moments = RunningMoments(3)
    for batch in samples.split([1, 99, 150, 250]):
        moments.update(batch, Workers())
    torch.testing.assert_close(moments.mean, samples.mean(0))
    torch.testing.assert_close(moments.variance, samples.var(0, unbiased=False))


def test_normalisation_is_affine_far_outside_what_was_seen():
    moments = RunningMoments(1)
    moments.update(torch.randn(100, 1), Workers())
    at_zero, at_ten, at_million = moments(torch.tensor([[0.0], [10.0], [1e6]]))
    torch.testing.assert_close((at_million - at_zero) / (at_ten - at_zero), torch.tensor([1e5]))
