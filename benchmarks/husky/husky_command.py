"""``python -m benchmarks husky``: the paper's case study: Huskies and LIMOs on wheels that slip.

Every method of the paper's tables drives robots of the plant ``mujoco`` on three grounds, from places and
headings drawn at random. Rows that the file holds are not computed again. An episode is satisfied if all
held their goals within the time, none touched another, the margin was kept throughout, and the limit in all
but 0.5 % of the time.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from benchmarks.common.flags import COUNT, POLICIES, make_parser
from benchmarks.common.result_file import read_result, replaced, write_result
from benchmarks.common.result_page import table
from benchmarks.husky.cases import ASKED, TASK, Case, cases, settings_of
from benchmarks.husky.play import Ends, play
from benchmarks.paper.policies import find_policy
from benchmarks.paper.settings import FLOWS
from edge_runtime.common.flag_types import whole_number
from edge_runtime.policy.bundle import Bundle, load_bundle, packaged_bundle

RESULTS: Final = Path(__file__).parents[1] / "results" / "husky.json"
FIRST_SEED: Final = 800_000
"""Reserves and yaw rates were chosen on seeds below; no other evaluation draws its episodes from here on."""
SIDE_BY_SIDE: Final = 64
"""Robots in one world."""
TOLERATED: Final = 0.005
"""Share of an episode's time in which the limit may be broken."""


class Row(Case, frozen=True):
    """Episodes of one case; shares in percent, speeds and lengths in the robots' metres."""

    episodes: int
    first_seed: int
    margin_reserve_m: float
    """What it was asked to keep beyond the margin."""
    satisfied: float
    """Of the episodes: all of what follows at once."""
    arrived: float
    """Without contact."""
    without_contact: float
    margin_kept: float
    """In every moment."""
    limit_kept: float
    """In all but `TOLERATED` of the time."""
    speeding: float
    """Of the time in which any robot was too fast, and of that in which two were too near."""
    near: float
    fastest_m_s: float
    nearest_m: float
    arrival_s: float | None
    """Mean time until all were at their goals; None where none ever were."""

    @property
    def case(self) -> Case:
        """What was measured."""
        return Case(self.base, self.robots, self.friction, self.method)


def main(arguments: Sequence[str]) -> int:
    """Drive what is missing, print, write the rows."""
    parser = make_parser("husky", __doc__)
    parser.add_argument("--episodes", type=COUNT, default=100, help="of each row (100)")
    parser.add_argument(
        "--first-seed", type=whole_number(0, 10**9), default=FIRST_SEED, metavar="N", help=f"({FIRST_SEED})"
    )
    parser.add_argument("--cases", type=COUNT, metavar="N", help="only the first so many")
    parser.add_argument("--jobs", type=COUNT, default=2, metavar="N", help="processes (2)")
    parser.add_argument("--json", type=Path, default=RESULTS, metavar="FILE", help="where the rows go")
    flags = parser.parse_args(arguments)
    rows, asked = read_result(flags.json, list[Row], default=[]), cases()[: flags.cases]
    known = {_question(row) for row in rows}
    todo = [case for case in asked if (case, flags.episodes, flags.first_seed, _reserve_m(case)) not in known]
    with ProcessPoolExecutor(flags.jobs) as pool:
        futures = [pool.submit(measure, case, flags.episodes, flags.first_seed) for case in todo]
        for future in as_completed(futures):
            rows = replaced(rows, [future.result()], lambda row: row.case)
            write_result(flags.json, rows)
    order = {case: place for place, case in enumerate(asked)}
    found = [row for row in rows if row.case in order]
    print(husky_table(sorted(found, key=lambda row: order[row.case])))
    return 0


def measure(case: Case, episodes: int, first_seed: int) -> Row:
    """Drive the episodes of so many seeds."""
    seeds, bundle, found = range(first_seed, first_seed + episodes), _bundle(case.method), []
    aside = SIDE_BY_SIDE // case.robots
    for start in range(0, episodes, aside):
        found.append(play(case, bundle, seeds[start : start + aside]))
    ends = Ends(*(np.concatenate(values) for values in zip(*found, strict=True)))
    arrived = np.isfinite(ends.arrival_s)
    clear, kept, slow = ~ends.touched, ends.near == 0.0, ends.speeding <= TOLERATED
    percent = [
        100.0 * float(one.mean())
        for one in (arrived & clear & kept & slow, arrived & clear, clear, kept, slow)
    ]
    shares = [100.0 * float(share.mean()) for share in (ends.speeding, ends.near)]
    mean_s = float(ends.arrival_s[arrived].mean()) if arrived.any() else None
    extremes = float(ends.fastest_m_s.max()), float(ends.nearest_m.min())
    seen = (*percent, *shares, *extremes, mean_s)
    return Row(*msgspec.structs.astuple(case), episodes, first_seed, _reserve_m(case), *seen)


def husky_table(rows: Sequence[Row]) -> str:
    """Format rows as a Markdown table."""
    head = ["robots", "friction", "method", "reserve m", "satisfied %", "arrived %", "margin kept %"]
    head += ["limit kept %", "speeding %", "fastest m/s", "nearest m", "arrival s"]
    lines = [
        [
            f"{row.robots} {row.base}",
            f"{row.friction:g}",
            row.method,
            f"{row.margin_reserve_m:g}",
            *(f"{value:.0f}" for value in (row.satisfied, row.arrived, row.margin_kept, row.limit_kept)),
            f"{row.speeding:.2f}",
            f"{row.fastest_m_s:.2f}",
            f"{row.nearest_m:.2f}",
            "-" if row.arrival_s is None else f"{row.arrival_s:.1f}",
        ]
        for row in rows
    ]
    return table(head, lines)


def _bundle(method: str) -> Bundle:
    """The packaged flow, or the first seed's policy of what the method needs."""
    algorithm = settings_of(method).algorithm(TASK)
    if algorithm == FLOWS[TASK]:
        return packaged_bundle(TASK)
    return load_bundle(find_policy(POLICIES, TASK, algorithm, 0))


def _reserve_m(case: Case) -> float:
    return ASKED[case.base].margin_reserve_m


def _question(row: Row) -> tuple[Case, int, int, float]:
    return row.case, row.episodes, row.first_seed, row.margin_reserve_m
