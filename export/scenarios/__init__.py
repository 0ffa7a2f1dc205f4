"""Training scenarios and what their policies observe, act on and are scored by."""

import torch

from edge_runtime.errors import ConfigError
from export.scenarios.balance import Balance
from export.scenarios.navigation import Navigation
from export.scenarios.sampling import Sampling
from export.scenarios.scenario import Scenario

SCENARIOS = {"balance": Balance, "navigation": Navigation, "sampling": Sampling}


def make_scenario(
    name: str, environments: int, seed: int, device: torch.device, *, training: bool
) -> Scenario:
    """Build a batch of B = ``environments`` teams; ``training`` widens the start distribution.

    Raises:
        ConfigError: if no scenario has this name.
    """
    if name not in SCENARIOS:
        raise ConfigError(f"unknown scenario '{name}': choose one of {', '.join(sorted(SCENARIOS))}")
    return SCENARIOS[name](environments, seed, device, training=training)
