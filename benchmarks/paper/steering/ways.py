"""Ways to follow objectives: along the flow, after it, or both."""

from msgspec.structs import replace

from benchmarks.paper.settings import Guided
from edge_runtime.guidance.settings import GuidanceSettings, Mode

SCALES = (3.0, 30.0)
"""eta of every way along the flow; the best one counts."""


def _way(mode: Mode, scale: float, noise: float, **changes: bool) -> Guided:
    return Guided(guidance=GuidanceSettings(mode=mode, scale=scale, start_noise=noise), **changes)


def ways(noise: float) -> dict[str, list[Guided]]:
    """Every way, with the settings among which its best is chosen.

    Args:
        noise: of the flow's start: 1 lets it choose among its modes, 0 is contracted to its mean.
    """
    along: dict[str, tuple[Mode, dict[str, bool]]] = {
        "along the flow: sum": ("none", {}),
        "sum, no Jacobian": ("none", {"jacobian": False}),
        "cone": ("cone", {}),
        "eqs. 14, 15 per robot": ("hierarchical", {}),
        "eqs. 14, 15 joint": ("hierarchical", {"joint": True}),
        "both: along, then corrected": ("terminal", {}),
        "both, no Jacobian": ("terminal", {"jacobian": False}),
    }
    steered = {
        name: [_way(mode, scale, noise, **changes) for scale in SCALES]
        for name, (mode, changes) in along.items()
    }
    corrected = _way("correction", SCALES[0], noise)
    once = replace(corrected, guidance=replace(corrected.guidance, requirement_steps=1))
    return {"corrected only": [corrected], "corrected in one step": [once], **steered}
