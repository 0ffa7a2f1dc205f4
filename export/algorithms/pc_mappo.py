"""Preference-conditioned MAPPO: the paper's baseline that is told its execution objectives in training.

The algorithm is MAPPO; what differs is the scenario (``export.scenarios.preferred``): robots observe how
much the task and each execution objective count in this episode, and are rewarded accordingly. At
execution time the preference is an input like any other, and nothing guides the action.
"""

from export.algorithms.mappo import Mappo


class PcMappo(Mappo):
    """MAPPO on a scenario with preferences."""

    name = "pc-mappo"
