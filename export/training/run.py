"""One training run in its directory: start or resume, train, validate, checkpoint."""

import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import torch
from msgspec.structs import asdict, replace

from edge_runtime.common.commit import commit
from edge_runtime.errors import ConfigError
from export.algorithms.base import TrainingSettings
from export.common.distributed import Workers
from export.scenarios import make_scenario
from export.training.checkpoint import CHECKPOINT, PolicyFacts, save, save_policy, taken_from
from export.training.metrics import MetricsRow, draw_curve, write_table
from export.training.request import Request, check_request, make_algorithm
from export.training.trainer import Trainer
from export.training.validation import Validated, Validation
from export.training.warm_start import warm_start


class TrainingRun:
    """One worker's side of a run; the leading worker writes the files."""

    def __init__(self, request: Request, workers: Workers, settings: TrainingSettings | None = None) -> None:
        """Start anew, or continue where the last checkpoint was made.

        Raises:
            ConfigError: as `check_request`, or if the checkpoint holds what training does not write.
        """
        beginning = check_request(request, workers.count, settings)
        self._request, self._workers, self._identity = request, workers, beginning.identity
        seeds = np.random.SeedSequence([request.seed, workers.rank]).generate_state(2).tolist()
        share = beginning.settings.environments // workers.count
        scenario = make_scenario(
            request.scenario, share, seeds[0], workers.device, training=True, preferred=request.preferred
        )
        self.facts = scenario.facts
        generator = torch.Generator(workers.device).manual_seed(seeds[1])
        with torch.random.fork_rng():
            torch.manual_seed(request.seed)  # initial weights are equal in all workers
            algorithm = make_algorithm(request)
            warm = beginning.warm
            if warm:  # before the trainer, which takes a copy of the weights
                warm_start(algorithm.actor.as_flow(), warm.gaussian, request.scenario, request.seed)
            self.trainer = Trainer(scenario, algorithm, beginning.settings, generator, workers)
            if warm:
                self.trainer.adopt_critic(warm.trainer)
        self._validation = Validation(
            request.scenario, beginning.settings, workers, preferred=request.preferred
        )
        self.rows: list[MetricsRow] = []
        self.best_score = float("-inf")
        if beginning.saved:
            with taken_from(request.out / CHECKPOINT, "run"):
                self._restore(beginning.saved)
            return
        if warm:
            self._validate()  # learning on may make nothing better
        self._checkpoint()

    def train(self, show: Callable[[MetricsRow], None]) -> None:
        """Train to the end; ``show`` is called after every update, when the checkpoint holds it.

        Raises:
            ConfigError: if a file cannot be written.
        """
        before = self.rows[-1].seconds if self.rows else 0.0
        began = time.monotonic()
        while self.trainer.frames < self.trainer.settings.whole_frames:
            row = self._update(lambda: before + time.monotonic() - began)
            due = (len(self.rows) + 1) % self.trainer.settings.validation_every == 0
            due = due or self.trainer.frames >= self.trainer.settings.whole_frames
            self.rows.append(self._validated(row) if due else row)
            self._checkpoint()
            if due:
                self._write(self._draw)
            self._write(lambda: show(self.rows[-1]))  # who reads it may be gone

    def _update(self, clock: Callable[[], float]) -> MetricsRow:
        rate = self.trainer.learning_rate
        episodes, update = self.trainer.iterate()
        return MetricsRow(
            frames=self.trainer.frames,
            seconds=round(clock(), 1),
            mean_return=episodes.mean_return if episodes else None,
            success=episodes.success if episodes else None,
            failure=episodes.failure if episodes else None,
            ratio_change=update.ratio_change,
            value_loss=update.value_loss,
            learning_rate=rate,
        )

    def _validate(self) -> Validated:
        """Keep the policy if none before was better."""
        deployed = self.trainer.deployed
        found = self._validation.run(deployed, self.trainer.progress)
        if found.score >= self.best_score:
            self.best_score = found.score
            facts = self._policy_facts()
            self._write(lambda: save_policy(self._request.out, deployed.actor, facts))
        return found

    def _validated(self, row: MetricsRow) -> MetricsRow:
        found = self._validate()
        return replace(
            row,
            validation_return=found.alone.mean_return,
            validation_success=found.alone.success,
            validation_failure=found.alone.failure,
            guided_success=found.guided_success,
            score=found.score,
        )

    def _policy_facts(self) -> PolicyFacts:
        return PolicyFacts(
            scenario=self._request.scenario,
            algorithm=self._request.algorithm,
            seed=self._request.seed,
            frames=self.trainer.frames,
            commit=commit(),
            score=self.best_score,
            euler_steps=self.trainer.algorithm.euler_steps,
            start=self.trainer.algorithm.actor.start,
            preferred=self._request.preferred,
        )

    def _checkpoint(self) -> None:
        out = self._request.out
        state = {
            "identity": asdict(self._identity),
            "trainer": self.trainer.state_dict(),
            "workers": self._workers.gather(self.trainer.worker_state_dict()),
            "rows": [asdict(row) for row in self.rows],
            "best_score": self.best_score,
        }
        self._write(lambda: save(out / CHECKPOINT, state))
        if self.rows:
            self._write(lambda: write_table(out / "metrics.csv", self.rows))

    def _draw(self) -> None:
        title = f"{self._request.algorithm} on {self._request.scenario}, seed {self._request.seed}"
        draw_curve(self._request.out / "curve.png", self.rows, title, self.facts.failure)

    def _write(self, write: Callable[[], None]) -> None:
        """Let the leading worker write; where it cannot, all workers end alike."""
        failure: ConfigError | OSError | None = None
        if self._workers.leads:
            try:
                write()
            except (ConfigError, OSError) as error:
                failure = error
        for reported in self._workers.gather(failure):
            if reported:
                raise reported

    def _restore(self, saved: dict[str, Any]) -> None:
        workers, rank = saved["workers"], self._workers.rank
        self.trainer.load_state_dict(saved["trainer"])
        self.rows = msgspec.convert(saved["rows"], list[MetricsRow])
        self.best_score = msgspec.convert(saved["best_score"], float)
        settings = self.trainer.settings
        counted = [settings.environments * settings.steps * (k + 1) for k in range(len(self.rows))]
        if [row.frames for row in self.rows] != counted or self.trainer.frames != max(counted, default=0):
            raise ValueError("frames are not counted as training does")
        if len(workers) != self._workers.count or not self.best_score <= 1.0:
            raise ValueError("neither so many workers nor such a score can be")
        for state in (*workers, workers[rank]):  # each tries all: what one refuses, every one does
            self.trainer.load_worker_state_dict(state)
