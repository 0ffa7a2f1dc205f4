"""``python -m benchmarks team_size``: one Navigation policy with 2 to 32 robots, less room, other masses.

Trained with four robots; nothing is trained anew. Interrupt it and start it again as you like; ``chrt -i 0``
in front of it leaves the machine to others.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import torch
from rich.progress import Progress

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.common.result_page import page, table
from benchmarks.paper.policies import digest, find_policy
from benchmarks.paper.statistics import summarise
from benchmarks.paper.team_size.measure import measure
from benchmarks.paper.team_size.teams import Team, TeamRow, teams
from benchmarks.paper.tuning import tuned_default

RESULTS = Path(__file__).parents[2] / "results" / "team_size.json"
HELD_OUT = (1, 2)
"""Seeds of the policies; guidance was tuned on seed 0."""
NOTE = """\
Navigation under the tuned default, by policies that were trained with four robots; means over seeds.
*Success*: all at their goals at once within the time limit, which grows as the arena does, no collision
before, speed limit and margin kept. *At goal*: of the robots, when an episode ends. *Tick*: one robot's,
processor time of the numpy runtime. Failures by kind, in percent of the episodes, as `python -m benchmarks
oracle` tells them apart."""
HEADER = (
    *("team", "success, %", "at goal, %", "contact, %", "speeding, %", "margin, %", "time to goal, s"),
    *("tick, us", "failures"),
)


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("team_size", __doc__)
    parser.add_argument("--episodes", type=COUNT, default=100, help="of each row (100)")
    parser.add_argument("--seeds", type=int, nargs="*", default=HELD_OUT, help="of the policies (1 2)")
    parser.add_argument("--largest", type=COUNT, default=32, metavar="N", help="of the teams (32)")
    add_policies(parser)
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    algorithm = tuned_default("navigation").algorithm("navigation")
    policies = {seed: find_policy(options.policies, "navigation", algorithm, seed) for seed in options.seeds}
    chapters = {name: [one for one in own if one.robots <= options.largest] for name, own in teams()}
    asked = [(team, seed) for own in chapters.values() for team in own for seed in options.seeds]
    rows = read_result(options.json, list[TeamRow], default=[])
    known = {row.key for row in rows}
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("rows", total=len(asked))
        for team, seed in sorted(asked, key=lambda each: each[0].robots):
            if (team, digest(policies[seed]), options.episodes) not in known:
                rows.append(measure(team, seed, policies[seed], options.episodes))
                write_result(options.json, rows)
            progress.advance(bar)
    keys = {digest(policy) for policy in policies.values()}
    own = [row for row in rows if row.policy in keys and row.episodes == options.episodes]
    text = team_page(chapters, own)
    (options.json.parent / "paper").mkdir(exist_ok=True)
    (options.json.parent / "paper" / "team_size.md").write_text(text)
    print(text)
    return 0


def team_page(chapters: dict[str, list[Team]], rows: Sequence[TeamRow]) -> str:
    """All teams in Markdown, chapter by chapter."""
    parts = [NOTE, _circumstances(rows)]
    for name, own in chapters.items():
        lines = [_line(team, [row for row in rows if row.team == team]) for team in own]
        parts += [f"## {name}", table(HEADER, lines)] * bool(lines)
    return page("Teams of other sizes", "team_size", *parts)


def _circumstances(rows: Sequence[TeamRow]) -> str:
    seeds = ", ".join(sorted({str(row.seed) for row in rows}))
    return f"Policies of seeds {seeds}, {rows[0].episodes} episodes of each."


def _line(team: Team, rows: Sequence[TeamRow]) -> list[str]:
    def mean(name: str) -> float:
        return summarise([getattr(row, name) for row in rows]).mean

    times = [row.time_to_goal_s for row in rows if row.time_to_goal_s is not None]
    kinds = sorted({kind for row in rows for kind in row.failures})
    failures = {kind: summarise([row.failures.get(kind, 0.0) for row in rows]).mean for kind in kinds}
    worst = sorted(failures.items(), key=lambda each: -each[1])
    names = ("success", "at_goal", "contact", "speeding", "margin")
    return [
        _name(team),
        *(f"{mean(name):.1f}" for name in names),
        f"{summarise(times).mean:.1f}" if times else "none",
        f"{mean('tick_us'):.0f}",
        ", ".join(f"{kind} {share:.1f}" for kind, share in worst) or "none",
    ]


def _name(team: Team) -> str:
    words = [f"{team.robots} robots"]
    words += [f"{team.crowding:g} times as many to the area"] * (team.crowding != 1.0)
    words += [f"K = {team.neighbours}"] * (team.neighbours is not None)
    return ", ".join(words)
