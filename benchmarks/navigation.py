"""``python -m benchmarks navigation``: what guidance does on Navigation, mode by mode.

Episodes are fresh, from a seed that neither training nor the choice of guidance scales has used. Success:
all robots at their goals at once within the time limit, no collision before. Multi-objective success: that,
with each objective violated in at most 5 % of the episode's steps; strict: in none.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import numpy as np
from rich.progress import Progress

from benchmarks.episodes import Episodes, run_episodes
from edge_runtime.guidance.settings import GuidanceSettings
from edge_runtime.objectives import SafetyMargin, SpeedLimit
from edge_runtime.policy.bundle import load_bundle, packaged_bundle

RESULTS = Path(__file__).parent / "results" / "navigation.json"
LIMITS = (SpeedLimit(limit_m_s=0.3), SafetyMargin(distance_m=0.25))
TOLERANCE = 0.05
"""Share of an episode's steps that may violate an objective in a multi-objective success."""


class Row(msgspec.Struct, frozen=True):
    """One line of the table: rates in percent with their standard errors."""

    mode: str
    scale: float
    start_noise: float
    episodes: int
    success: tuple[float, float]
    collision: tuple[float, float]
    speeding_violation: tuple[float, float]
    margin_violation: tuple[float, float]
    multi_objective_success: tuple[float, float]
    strict_success: tuple[float, float]
    mean_steps: float


def main(arguments: Sequence[str]) -> int:
    """Run the evaluation, print the table and write the rows."""
    options = _parse(arguments)
    bundle = load_bundle(options.policy) if options.policy else packaged_bundle("navigation")
    settings = [
        GuidanceSettings(mode=mode, scale=scale, start_noise=noise)
        for noise in options.noise
        for mode in options.modes
        for scale in options.scales
    ]
    cases = [(GuidanceSettings(scale=0.0, start_noise=noise), "unguided") for noise in options.noise]
    cases += [(setting, setting.mode) for setting in settings]
    rows = []
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("episodes", total=options.episodes * len(cases))
        for setting, name in cases:
            done: Callable[[int], None] = lambda count: progress.advance(bar, count)  # noqa: E731
            result = run_episodes(bundle, LIMITS, setting, LIMITS, options.episodes, options.seed, done)
            rows.append(_row(name, setting, result))
    print(table(rows))
    options.json.parent.mkdir(parents=True, exist_ok=True)
    options.json.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=1) + b"\n")
    return 0


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks navigation", description=__doc__)
    parser.add_argument("--policy", type=Path, help="a bundle directory; default: the packaged one")
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--modes", nargs="*", default=["none", "hierarchical", "cone", "terminal"])
    parser.add_argument("--scales", nargs="*", type=float, default=[10.0], help="guidance scales eta")
    parser.add_argument("--noise", nargs="*", type=float, default=[0.0, 1.0], help="start noise")
    parser.add_argument("--json", type=Path, default=RESULTS)
    return parser.parse_args(arguments)


def _row(name: str, settings: GuidanceSettings, result: Episodes) -> Row:
    within = [rate <= TOLERANCE for rate in (result.speeding, result.too_close)]
    never = [rate == 0.0 for rate in (result.speeding, result.too_close)]
    return Row(
        mode=name,
        scale=settings.scale,
        start_noise=settings.start_noise,
        episodes=len(result.arrived),
        success=_percent(result.arrived),
        collision=_percent(result.collided),
        speeding_violation=_percent(result.speeding),
        margin_violation=_percent(result.too_close),
        multi_objective_success=_percent(result.arrived & within[0] & within[1]),
        strict_success=_percent(result.arrived & never[0] & never[1]),
        mean_steps=float(result.steps.mean()),
    )


def _percent(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard error over the episodes, in percent."""
    return 100 * float(values.mean()), 100 * float(values.std(ddof=1) / np.sqrt(len(values)))


def table(rows: Sequence[Row]) -> str:
    """Format rows as a Markdown table."""
    head = "| guidance | start noise | success % | speeding % | margin % | multi-objective % | strict % |"
    lines = [head, "|---" * 7 + "|"]
    for row in rows:
        rates = (
            row.success,
            row.speeding_violation,
            row.margin_violation,
            row.multi_objective_success,
            row.strict_success,
        )
        name = row.mode if row.mode == "unguided" else f"{row.mode}, eta {row.scale:g}"
        cells = [name, f"{row.start_noise:g}", *(f"{mean:.1f} ± {error:.1f}" for mean, error in rates)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
