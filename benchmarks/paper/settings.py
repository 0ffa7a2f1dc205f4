"""What a method is set to, as data: rows carry it, and `methods.decider` makes decisions of it."""

from typing import Literal

import msgspec

from edge_runtime.guidance.settings import GuidanceSettings

FLOWS = {"navigation": "mafpo-chain", "balance": "mafpo-warm", "sampling": "mafpo-chain"}
"""The guided flow policies, by task: on Balance those that follow guidance better, else the default."""


class _Settings(
    msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True, tag_field="kind"
):
    def algorithm(self, task: str) -> str:  # noqa: ARG002
        """What trained the policy of a task."""
        return "mappo"


def _seen(ease_m: float, *, belief: bool) -> list[str]:
    """What a method sees differently, in words."""
    return [f"ease {ease_m:g} m"] * (ease_m > 0.0) + ["belief"] * belief


def _at_goal(reach: float | None) -> list[str]:
    """How far actions are moved at the goal, in words."""
    return [] if reach is None else [f"{reach:g} at the goal"]


class Guided(_Settings, frozen=True, tag="guided"):
    """A flow policy, guided along its flow and, in mode ``terminal``, after it."""

    guidance: GuidanceSettings
    deconfliction: bool = False
    """With what keeps robots out of each other's way, where the task has it."""
    belief: bool = False
    """Drawn to where the robots believe most to be left, where the task has it."""
    look_ahead: int | None = None
    """Of all objectives, in control steps; None for their own."""
    look_ahead_factor: int = 1
    """Times as many steps."""
    joint: bool = False
    """Eqs. 14 and 15 on the team's joint action, instead of robot by robot."""
    jacobian: bool = True
    """Gradients along the flow pulled back through it, eq. 11; else as they are at the terminal estimate."""
    corrected_as: Literal["their own", "preferences", "requirements"] = "their own"
    """What objectives count as at tau = 1."""
    value_scale: float = 0.0
    """kappa of J - kappa Q at tau = 1, Q what `export.values` fitted."""
    value_first: bool = False
    """Q is followed before J."""

    def algorithm(self, task: str) -> str:
        """The task's flow."""
        return FLOWS[task]

    def __str__(self) -> str:
        guidance = self.guidance
        words = [guidance.mode, f"eta {guidance.scale:g}", f"noise {guidance.start_noise:g}"]
        words += [f"reach {guidance.reach:g}"] * (guidance.mode == "terminal")
        words += _at_goal(guidance.goal_reach)
        words += [f"look-ahead {self.look_ahead}"] * (self.look_ahead is not None)
        return ", ".join([*words, *_seen(guidance.ease_m, belief=self.belief)])


class Mean(_Settings, frozen=True, tag="mean"):
    """A Gaussian policy's mean, left alone."""

    def __str__(self) -> str:
        return "mean"


class Descent(_Settings, frozen=True, tag="descent"):
    """A Gaussian policy's mean, moved by projected gradient descent: see `baselines.descend`."""

    radius: float = 0.5
    """rho, in units of the action."""
    goal_radius: float | None = None
    """The same where what the team carries is at its goal, as `GuidanceSettings.goal_reach`."""
    rate: float = 0.3
    """alpha; 1 is a full Newton step of one objective."""
    steps: int = 20
    deconfliction: bool = False
    """With what keeps robots out of each other's way, where the task has it."""
    belief: bool = False
    """See `Guided.belief`."""
    ease_m: float = 0.0
    """As `GuidanceSettings.ease_m`."""

    def __str__(self) -> str:
        words = [f"radius {self.radius:g}", *_at_goal(self.goal_radius)]
        words += [f"rate {self.rate:g}", f"{self.steps} steps"]
        return ", ".join([*words, *_seen(self.ease_m, belief=self.belief)])


class Shield(_Settings, frozen=True, tag="shield"):
    """A Gaussian policy's mean, moved onto the safe set: see `baselines.shield`."""

    rounds: int = 1
    """Of projections onto every objective's safe set in turn."""
    belief: bool = False
    """See `Guided.belief`."""
    ease_m: float = 0.0
    """As `GuidanceSettings.ease_m`."""

    def __str__(self) -> str:
        return ", ".join([f"{self.rounds} rounds", *_seen(self.ease_m, belief=self.belief)])


class Preferring(_Settings, frozen=True, tag="preferring"):
    """A Gaussian policy's mean that observes what each objective counts, the nominal one first."""

    preference: tuple[float, float, float]

    def algorithm(self, task: str) -> str:  # noqa: ARG002
        """The one that was trained with preferences."""
        return "pc-mappo"

    def __str__(self) -> str:
        return "preference " + ", ".join(f"{weight:g}" for weight in self.preference)


Settings = Guided | Mean | Descent | Shield | Preferring

UNGUIDED = Guided(guidance=GuidanceSettings(mode="none", scale=0.0))
"""A flow alone, started from the paper's prior."""
