"""The oracle in Markdown: what is possible of each task, and how policies fail at the rest."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.common.result_page import page, table
from benchmarks.paper.possible import Ended, Row, possible, ruled_out
from benchmarks.paper.statistics import summarise

NOTE = """\
*Possible at least*: the episodes that the guided policy of one seed or another satisfies, and those of the
others for which a search with the full state, over all robots' actions, found a plan that does. *At most*:
all but the starts of Sampling from which nobody can gather in time, by a relaxation. Plans are judged as
policies are, by the frozen definitions."""
KINDS = """\
Episodes that the tuned default does not satisfy, by what they miss, per policy; *mean*: in percent of all
episodes, ± the standard deviation over policies. *Late*: satisfied within 5 s after the time limit.
*Stand-off*: two robots still short of their goals within sight of each other; *blocked*: one is, beside one
at its goal."""

Asked = Mapping[str, tuple[Sequence[Row], Sequence[Ended]]]
"""By task: all rows, and those of the present policies."""


def write_oracle(asked: Asked, path: Path) -> str:
    """Write the page; returns it."""
    parts = [NOTE, possible_table(asked), "## How the others end", KINDS]
    for task, (rows, ended) in asked.items():
        parts += [f"### {task.capitalize()}", endings_table(ended), _of_them(rows, ended, task)]
    text = page("What the tasks allow", "oracle", *parts)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return text


def possible_table(asked: Asked) -> str:
    """What policies reach, what is possible, and the one as a share of the other, in percent."""
    lines = []
    for task, (rows, ended) in asked.items():
        bounds = possible(rows, task)
        if bounds is None or not ended:
            continue
        success = [100.0 * (1.0 - len(row.failed) / row.episodes) for row in ended]
        shares = [100.0 * value / bounds.at_least for value in success]
        cells = [str(summarise(success)), *(f"{bound:.1f}" for bound in bounds), str(summarise(shares))]
        lines.append([task, *cells])
    names = ("default", "one policy or another", "possible at least", "at most", "default, of the possible")
    return table(["%", *names], lines)


def endings_table(ended: Sequence[Ended]) -> str:
    """Kinds of failure by seed, the most frequent first."""
    kinds = {kind for row in ended for kind in row.failures}
    lines = []
    for kind in sorted(kinds, key=lambda each: (-_mean(ended, each), each)):
        counts = [len(row.failures.get(kind, ())) for row in ended]
        shares = [100.0 * count / row.episodes for count, row in zip(counts, ended, strict=True)]
        lines.append([kind, str(summarise(shares)), *map(str, counts)])
    return table(["episodes", "mean, %", *(f"seed {row.seed}" for row in ended)], lines)


def _mean(ended: Sequence[Ended], kind: str) -> float:
    return summarise([float(len(row.failures.get(kind, ()))) for row in ended]).mean


def _of_them(rows: Sequence[Row], ended: Sequence[Ended], task: str) -> str:
    """How many failures nobody could have avoided."""
    impossible = ruled_out(rows, task)
    if not impossible:
        return ""
    shares = [100.0 * len(row.failed & impossible) / row.episodes for row in ended]
    return f"Of all episodes {summarise(shares)} % failed where the relaxation rules every plan out."
