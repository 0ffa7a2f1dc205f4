"""Training scenarios and what their policies observe, act on and are scored by."""

import contextlib
import io

import torch

with contextlib.redirect_stderr(io.StringIO()):  # gym prints an advertisement for its successor
    import vmas  # noqa: F401 - before anything else here imports it

from edge_runtime.errors import ConfigError
from export.scenarios.balance import Balance
from export.scenarios.navigation import Navigation
from export.scenarios.preferred import Preferred, with_preference
from export.scenarios.sampling import Sampling
from export.scenarios.scenario import Scenario, ScenarioFacts

SCENARIOS = {"balance": Balance, "navigation": Navigation, "sampling": Sampling}


def make_scenario(
    name: str,
    environments: int,
    seed: int,
    device: torch.device,
    *,
    training: bool,
    preferred: bool = False,
) -> Scenario:
    """Build a batch of B = ``environments`` teams.

    Args:
        name: a key of ``SCENARIOS``.
        environments: B.
        seed: of everything that is drawn.
        device: of all tensors.
        training: widen the start distribution.
        preferred: let robots know their execution objectives and how much each counts.

    Raises:
        ConfigError: if no scenario, or none with execution objectives, has this name.
    """
    scenario_facts(name, preferred=preferred)
    scenario = SCENARIOS[name](environments, seed, device, training=training)
    if not preferred:
        return scenario
    # Another seed, or preferences would repeat the numbers that starts were drawn from.
    return Preferred(scenario, seed + 1, training=training)


def scenario_facts(name: str, *, preferred: bool = False) -> ScenarioFacts:
    """Return what ``make_scenario`` would build; raises as that does."""
    if name not in SCENARIOS:
        raise ConfigError(f"unknown scenario '{name}': choose one of {', '.join(sorted(SCENARIOS))}")
    facts = SCENARIOS[name].facts
    return with_preference(facts) if preferred else facts
