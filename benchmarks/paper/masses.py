"""Robots of different masses in one team of VMAS Navigation."""

from collections.abc import Sequence

from export.scenarios.navigation import Navigation
from export.scenarios.scenario import Scenario


def set_masses(world: Scenario, masses_kg: Sequence[float]) -> None:
    """Give N simulated robots their masses; drag is a share of the velocity and does not depend on them.

    Raises:
        ValueError: if this is not Navigation, or the number of masses is another.
    """
    if not isinstance(world, Navigation):
        raise ValueError(f"only Navigation's robots can be given masses, not those of {world.facts.name}")
    for agent, mass in zip(world._agents, masses_kg, strict=True):
        agent.mass = mass
