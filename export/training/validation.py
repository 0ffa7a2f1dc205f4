"""How good the deployed policy is on episodes that it is never trained on."""

import torch

from export.algorithms.base import Algorithm
from export.common.distributed import Workers
from export.scenarios import make_scenario
from export.scenarios.scenario import EpisodeMetrics
from export.training.rollout import evaluate

VALIDATION_SEED = 20_000
"""Seeds of the starts and of the noise; worker r adds r, so up to thousands of workers stay disjoint."""


class Validation:
    """The same episodes every time; half of them start the flow from noise, half from zero."""

    def __init__(self, scenario: str, episodes: int, workers: Workers, *, preferred: bool) -> None:
        self._seed = VALIDATION_SEED + workers.rank
        self._workers = workers
        self._scenario = make_scenario(
            scenario,
            episodes // workers.count,
            self._seed,
            workers.device,
            training=False,
            preferred=preferred,
        )
        self._beginning = self._scenario.state_dict()
        self._zero_start = torch.arange(self._scenario.environments, device=workers.device) % 2 == 0

    def run(self, algorithm: Algorithm) -> tuple[EpisodeMetrics, float]:
        """Return the metrics of all workers' episodes, and the scenario's score of them."""
        self._scenario.load_state_dict(self._beginning)
        generator = torch.Generator(self._workers.device).manual_seed(self._seed)
        tally = evaluate(self._scenario, algorithm.act, generator, self._zero_start)
        tally.close(torch.ones_like(tally.decided))
        metrics = tally.take(self._workers)
        if metrics is None:
            raise ValueError("validation needs at least one episode a worker")
        return metrics, self._scenario.score(metrics)
