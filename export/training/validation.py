"""How good the deployed policy is on episodes that it is never trained on, alone and guided."""

from dataclasses import dataclass

import torch

from export.algorithms.base import Algorithm, TrainingSettings
from export.common.distributed import Workers
from export.scenarios import make_scenario
from export.scenarios.scenario import EpisodeMetrics
from export.training.guided_validation import GuidedValidation
from export.training.rollout import evaluate

VALIDATION_SEED = 20_000
"""Seeds of the starts and of the noise; worker r adds r, so up to thousands of workers stay disjoint."""
GUIDED_SHARE = 0.9
"""Of the score; the rest tells policies apart that cannot do all that is asked yet."""


@dataclass(frozen=True)
class Validated:
    """One validation."""

    alone: EpisodeMetrics
    guided_success: float | None
    """See `GuidedValidation`; None without, as for policies that observe what is asked of them instead, or
    where it is too early."""
    score: float
    """What the best state is chosen by; where it is too early, guided success counts as none."""


class Validation:
    """The same episodes every time; of those alone, half start the flow from noise, half from zero."""

    def __init__(
        self, scenario: str, settings: TrainingSettings, workers: Workers, *, preferred: bool
    ) -> None:
        self._seed = VALIDATION_SEED + workers.rank
        self._workers = workers
        self._scenario = make_scenario(
            scenario,
            settings.validation_episodes // workers.count,
            self._seed,
            workers.device,
            training=False,
            preferred=preferred,
        )
        self._beginning = self._scenario.state_dict()
        self._zero_start = torch.arange(self._scenario.environments, device=workers.device) % 2 == 0
        self._guided_from = settings.guided_from
        self._guided: GuidedValidation | None = None
        if settings.guided_episodes and not preferred:
            self._guided = GuidedValidation(scenario, settings.guided_episodes, workers)

    def run(self, algorithm: Algorithm, progress: float) -> Validated:
        """Play all workers' episodes; ``progress`` is the share of the training that is done."""
        alone = self._alone(algorithm)
        score = self._scenario.score(alone)
        if self._guided is None:
            return Validated(alone, None, score)
        guided = self._guided.run(algorithm) if progress >= self._guided_from else None
        return Validated(alone, guided, GUIDED_SHARE * (guided or 0.0) + (1.0 - GUIDED_SHARE) * score)

    def _alone(self, algorithm: Algorithm) -> EpisodeMetrics:
        self._scenario.load_state_dict(self._beginning)
        generator = torch.Generator(self._workers.device).manual_seed(self._seed)
        tally = evaluate(self._scenario, algorithm.act, generator, self._zero_start)
        tally.close(torch.ones_like(tally.decided))
        metrics = tally.take(self._workers)
        if metrics is None:
            raise ValueError("validation needs at least one episode a worker")
        return metrics
