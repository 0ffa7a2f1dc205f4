"""``python -m benchmarks team_size``: one Navigation policy with 2 to 32 robots, less room, other masses.

Trained with four robots; nothing is trained anew. Interrupt it and start it again as you like; ``chrt -i 0``
in front of it leaves the machine to others.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import torch
from rich.progress import Progress

from benchmarks.common.flags import COUNT, add_policies, make_parser
from benchmarks.common.result_file import read_result, write_result
from benchmarks.common.result_page import page, table
from benchmarks.paper.policies import SEEDS, find_policy
from benchmarks.paper.statistics import summarise
from benchmarks.paper.team_size.measure import SETTINGS, measure, question
from benchmarks.paper.team_size.teams import Asked, TeamQuestion, TeamRow, chapters

RESULTS = Path(__file__).parents[2] / "results" / "team_size.json"
NOTE = """\
Navigation guided with `ease_m` and five steps for requirements as in the tables, by policies that were
trained with four robots; means over their seeds.
*Success*: all at their goals at once within the time limit, which grows as the arena does, no collision
before, speed limit and margin kept. *At goal*: of the robots, when an episode ends. *Tick*: one robot's,
processor time of the numpy runtime. Failures by kind, in percent of the episodes, as `python -m benchmarks
oracle` tells them apart: two that hold each other off, one that a parked one blocks, or who is merely late.
Larger teams than four have a larger arena than the training's. In the first chapter their fleet files name
that one (`training_arena`), so that places beyond it are observed on its border; elsewhere they do not."""
HEADER = (
    *("team", "policies x episodes", "success, %", "worst policies", "at goal, %", "contact, %"),
    *("speeding, %", "margin, %", "time to goal, s", "tick, us", "failures"),
)
Chapters = Mapping[str, Sequence[tuple[str, Sequence[TeamRow]]]]
"""By its name, the teams of each, and a row of each seed."""


def main(arguments: Sequence[str]) -> int:
    """Returns 0; errors are the caller's to show."""
    parser = make_parser("team_size", __doc__)
    parser.add_argument("--episodes", type=COUNT, default=1000, help="of each row at most (1000)")
    parser.add_argument("--seeds", type=COUNT, default=SEEDS, help=f"policies at most ({SEEDS})")
    parser.add_argument("--largest", type=COUNT, default=32, metavar="N", help="of the teams (32)")
    add_policies(parser)
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="the rows")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    algorithm = SETTINGS.algorithm("navigation")
    find = partial(find_policy, options.policies, "navigation", algorithm)
    paths = [find(seed) for seed in range(options.seeds)]
    asked = {
        name: {
            str(one.team): list(_questions(one, paths, options.episodes))
            for one in own
            if one.team.robots <= options.largest
        }
        for name, own in chapters().items()
    }
    todo = [each for own in asked.values() for questions in own.values() for each in questions]
    known = _answer(todo, paths, options.json)
    text = team_page(
        {
            name: [(team, [known[each] for each in questions]) for team, questions in own.items()]
            for name, own in asked.items()
        }
    )
    (options.json.parent / "paper").mkdir(exist_ok=True)
    (options.json.parent / "paper" / "team_size.md").write_text(text)
    print(text)
    return 0


def _questions(asked: Asked, paths: Sequence[Path], most: int) -> Iterator[TeamQuestion]:
    for seed, path in enumerate(paths[: asked.seeds]):
        yield question(asked.team, seed, path, min(asked.episodes, most))


def _answer(asked: Sequence[TeamQuestion], paths: Sequence[Path], path: Path) -> dict[TeamQuestion, TeamRow]:
    """Answer what the file of rows does not; it keeps what it held."""
    known = {row.question: row for row in read_result(path, list[TeamRow], default=[])}
    with Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task("robots' episodes", total=sum(each.robots * each.episodes for each in asked))
        for each in sorted(asked, key=lambda one: one.robots * one.episodes):
            if each not in known:
                known[each] = measure(each, paths[each.seed])
                write_result(path, list(known.values()))
            progress.advance(bar, each.robots * each.episodes)
    return known


def team_page(chapters: Chapters) -> str:
    """All teams in Markdown, chapter by chapter."""
    parts = [NOTE]
    for name, own in chapters.items():
        parts += [f"## {name}", table(HEADER, [_line(*each) for each in own])] * bool(own)
    return page("Teams of other sizes", "team_size", *parts)


def _line(team: str, rows: Sequence[TeamRow]) -> list[str]:
    def mean(name: str) -> float:
        return summarise([getattr(row, name) for row in rows]).mean

    times = [row.time_to_goal_s for row in rows if row.time_to_goal_s is not None]
    kinds = sorted({kind for row in rows for kind in row.failures})
    failures = {kind: summarise([row.failures.get(kind, 0.0) for row in rows]).mean for kind in kinds}
    most_first = sorted(failures.items(), key=lambda each: -each[1])
    return [
        team,
        f"{len(rows)} x {rows[0].episodes}",
        f"{mean('success'):.1f}",
        ", ".join(f"{success:.1f}" for success in sorted(row.success for row in rows)[:3]),
        *(f"{mean(name):.1f}" for name in ("at_goal", "contact", "speeding", "margin")),
        f"{summarise(times).mean:.1f}" if times else "none",
        f"{mean('tick_us'):.0f}",
        ", ".join(f"{kind} {share:.1f}" for kind, share in most_first) or "none",
    ]
