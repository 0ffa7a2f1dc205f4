"""``python -m benchmarks layout LOG``: what the Foxglove layout of the documentation shows of a log.

A drawing by matplotlib, panel by panel where `docs/foxglove.json` puts it, from the messages that its paths
name. Foxglove itself needs an account and a screen; the data, the places and the names are the same.
"""

import json
import math
import re
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final, NamedTuple

from mcap.reader import make_reader

from benchmarks.common.flags import make_parser
from edge_runtime.common.command_line import check_writable
from edge_runtime.errors import ConfigError

LAYOUT: Final = Path(__file__).parents[1] / "docs" / "foxglove.json"
PICTURE: Final = LAYOUT.parent / "pictures" / "foxglove.png"
_INCHES: Final = (13.0, 8.0)
_LINES, _COLUMNS = 14, 44
"""Of text in a panel."""

Messages = dict[str, list[tuple[float, Any]]]
"""By topic: seconds since the log's first message, and the message as JSON has it."""


class Rectangle(NamedTuple):
    """Where a panel lies, as shares of the whole, from the upper left corner."""

    left: float
    top: float
    width: float
    height: float


def read_messages(path: Path) -> Messages:
    """Read a log's messages by topic."""
    found: Messages = {}
    with path.open("rb") as file:
        read = [(channel.topic, one) for _, channel, one in make_reader(file).iter_messages()]
    if not read:
        raise ConfigError(f"{path}: holds no messages")
    start_ns = read[0][1].log_time
    for topic, message in read:
        found.setdefault(topic, []).append((1e-9 * (message.log_time - start_ns), json.loads(message.data)))
    return found


def values(message: Any, steps: Sequence[str]) -> Iterator[float]:  # noqa: ANN401  # JSON of any form
    """Yield what a path's steps lead to: keys, places in a list, or ``:`` for all of them."""
    if not steps:
        yield message
    elif steps[0] == ":":
        for item in message:
            yield from values(item, steps[1:])
    else:
        key: str | int = int(steps[0]) if steps[0].isdigit() else steps[0]
        yield from values(message[key], steps[1:])


def series(messages: Messages, path: str) -> tuple[list[float], list[list[float]]]:
    """The times and values that a plot's path names, such as ``/action.costs[:]``."""
    topic, *steps = re.findall(r"[^.\[\]]+", path)
    rows = [(time_s, list(values(message, steps))) for time_s, message in messages[topic]]
    return [time_s for time_s, _ in rows], [row for _, row in rows]


def places(layout: Any, whole: Rectangle = Rectangle(0.0, 0.0, 1.0, 1.0)) -> Iterator[tuple[str, Rectangle]]:  # noqa: ANN401, B008
    """Yield every panel of a layout's tree, and where it lies."""
    if isinstance(layout, str):
        yield layout, whole
        return
    share, (left, top, width, height) = layout["splitPercentage"] / 100.0, whole
    if layout["direction"] == "row":
        first = Rectangle(left, top, share * width, height)
        second = Rectangle(left + first.width, top, width - first.width, height)
    else:
        first = Rectangle(left, top, width, share * height)
        second = Rectangle(left, top + first.height, width, height - first.height)
    yield from places(layout["first"], first)
    yield from places(layout["second"], second)


def main(arguments: Sequence[str]) -> int:
    """Draw a log as the layout has it."""
    parser = make_parser("layout", __doc__)
    parser.add_argument("log", type=Path, metavar="LOG", help="an MCAP file of edge-run")
    parser.add_argument("-o", "--output", type=Path, default=PICTURE, metavar="FILE", help="the picture")
    flags = parser.parse_args(arguments)
    check_writable(flags.output)
    draw(json.loads(LAYOUT.read_text()), read_messages(flags.log), flags.output)
    return 0


def draw(layout: Any, messages: Messages, path: Path) -> None:  # noqa: ANN401
    """Draw every panel."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # only where something is drawn

    figure = Figure(figsize=_INCHES)
    for name, place in places(layout["layout"]):
        axes = figure.add_axes(
            (
                place.left + 0.05,
                1.0 - place.top - place.height + 0.05,
                place.width - 0.07,
                place.height - 0.09,
            )
        )
        kind, _, title = name.partition("!")
        config = layout["configById"][name]
        axes.set_title(config.get("title", title), fontsize=9, loc="left")
        _PANELS[kind](axes, config, messages)
    figure.savefig(path, dpi=90)


def _plot(axes: Any, config: Any, messages: Messages) -> None:  # noqa: ANN401
    for line in config["paths"]:
        times, rows = series(messages, line["value"])
        for index, column in enumerate(zip_longest(*rows, fillvalue=math.nan)):
            label = line["label"] + (f" {index}" if ":" in line["value"] else "")
            axes.plot(times, column, linewidth=1, label=label)
    axes.legend(fontsize=7, loc="upper right")


def _team(axes: Any, config: Any, messages: Messages) -> None:  # noqa: ANN401
    for topic in config["topics"]:
        poses = [message["poses"] for _, message in messages[topic]]
        for shown, mark in ((chain(*poses), "C0."), (poses[-1], "ko")):
            x, y = zip(*((pose["position"]["x"], pose["position"]["y"]) for pose in shown), strict=True)
            axes.plot(x, y, mark, markersize=2 if mark == "C0." else 6)
    axes.set_aspect("equal", "datalim")
    axes.grid(visible=True, linewidth=0.3)


def _log(axes: Any, config: Any, messages: Messages) -> None:  # noqa: ANN401
    lines = [
        f"{time_s:5.1f}  {one['name']}: {one['message']}" for time_s, one in messages[config["topicToRender"]]
    ]
    _write(axes, lines)


def _raw(axes: Any, config: Any, messages: Messages) -> None:  # noqa: ANN401
    _write(axes, json.dumps(messages[config["topicPath"]][-1][1], indent=1).splitlines())


def _write(axes: Any, lines: Sequence[str]) -> None:  # noqa: ANN401
    axes.axis("off")
    axes.text(
        0.0,
        1.0,
        "\n".join(line[:_COLUMNS] for line in lines[:_LINES]),
        va="top",
        family="monospace",
        fontsize=7,
    )


_PANELS: Final = {"3D": _team, "Plot": _plot, "RosOut": _log, "RawMessages": _raw}
