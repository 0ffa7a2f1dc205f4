"""The robot side: observe, sample a flow policy guided by execution-time objectives, command.

The names of `__all__` are what programs of one's own may build on; each is imported when it is first used,
so that commands start quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from edge_runtime.config.objectives import load_objective_set
    from edge_runtime.errors import EdgeError
    from edge_runtime.guidance.flow import guided_action
    from edge_runtime.guidance.guide import Guide, guide_for
    from edge_runtime.guidance.settings import GuidanceSettings, ObjectiveSet
    from edge_runtime.messages import GuidedAction, Reading, RobotState, Teammate, TeamState, TrackedObject
    from edge_runtime.objectives import Objective, Slope
    from edge_runtime.objectives.gradient_check import check_gradient
    from edge_runtime.observation import Source, View
    from edge_runtime.observation.belief import Belief
    from edge_runtime.observation.observer import Observer
    from edge_runtime.policy.bundle import Bundle, load_bundle, packaged_bundle

__version__: Final = "0.1.0"

_HOMES: Final = {
    "Belief": "observation.belief",
    "Bundle": "policy.bundle",
    "EdgeError": "errors",
    "GuidanceSettings": "guidance.settings",
    "Guide": "guidance.guide",
    "GuidedAction": "messages",
    "Objective": "objectives",
    "ObjectiveSet": "guidance.settings",
    "Observer": "observation.observer",
    "Reading": "messages",
    "RobotState": "messages",
    "Slope": "objectives",
    "Source": "observation",
    "TeamState": "messages",
    "Teammate": "messages",
    "TrackedObject": "messages",
    "View": "observation",
    "check_gradient": "objectives.gradient_check",
    "guide_for": "guidance.guide",
    "guided_action": "guidance.flow",
    "load_bundle": "policy.bundle",
    "load_objective_set": "config.objectives",
    "packaged_bundle": "policy.bundle",
}

__all__ = [
    "Belief",
    "Bundle",
    "EdgeError",
    "GuidanceSettings",
    "Guide",
    "GuidedAction",
    "Objective",
    "ObjectiveSet",
    "Observer",
    "Reading",
    "RobotState",
    "Slope",
    "Source",
    "TeamState",
    "Teammate",
    "TrackedObject",
    "View",
    "__version__",
    "check_gradient",
    "guide_for",
    "guided_action",
    "load_bundle",
    "load_objective_set",
    "packaged_bundle",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401  # type checkers read the imports above
    """Import a public name where it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(__all__)}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
