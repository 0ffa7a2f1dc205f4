"""Drawings that belong to their page: its colours in light, dark and print, its type, no id twice.

matplotlib writes fixed colours. So figures are drawn with a few colours that nothing else uses, and these
become the page's variables in the SVG.
"""

import functools
import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, ParamSpec

from edge_runtime.common.command_line import need

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

INK: Final = "#010203"
SOFT: Final = "#010204"
RULE: Final = "#010205"
PAPER: Final = "#010206"
LIMIT: Final = "#010207"
BAD: Final = "#010208"
_VARIABLES: Final = {INK: "ink", SOFT: "soft", RULE: "rule", PAPER: "paper", LIMIT: "limit", BAD: "bad"}

SERIES: Final = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#7f7f7f")
"""Told apart with any colour vision: the palette of Okabe and Ito without its black and yellow, which fade
into one of the backgrounds."""
DASHES: Final = ("-", (0, (4, 1.5)), (0, (1, 1)))
"""Taken in turn when the colours are used up."""

WIDTH_IN: Final = 5.0
"""Type of 10 points in a figure this wide is readable on a phone, where it fills the screen."""
_STYLE: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.size": 10.0,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": SOFT,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "legend.handlelength": 1.4,
    "lines.linewidth": 1.3,
    "figure.facecolor": "none",
    "figure.constrained_layout.use": True,
}


def drawing(draw: Callable[P, "Figure"]) -> Callable[P, str]:
    """Make a function that draws a figure return it as SVG, in the page's style.

    Raises:
        ConfigError: from the function, if matplotlib is not installed.
    """

    @functools.wraps(draw)
    def draw_svg(*args: P.args, **kwargs: P.kwargs) -> str:
        need("matplotlib", "report")
        import matplotlib as mpl  # noqa: PLC0415  # an extra

        with mpl.rc_context(_STYLE):
            return _to_svg(draw(*args, **kwargs))

    return draw_svg


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> "Figure":
    """Return an empty figure; for functions that are a `drawing`."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # an extra

    return Figure(figsize=(width_in, height_in), layout="constrained")


def colour(index: int) -> str:
    """Return the colour of one of several things."""
    return SERIES[index % len(SERIES)]


def line_style(index: int, name: str) -> dict[str, Any]:
    """Return the look of one of several lines."""
    return {"color": colour(index), "linestyle": DASHES[index // len(SERIES) % len(DASHES)], "label": name}


def legend(figure: "Figure", names: int) -> None:
    """Name what is drawn above the axes, where there are several."""
    if names > 1:
        figure.legend(loc="outside upper left", ncols=min(names, 4))


def _to_svg(figure: "Figure") -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    for shade, name in _VARIABLES.items():
        svg = svg.replace(shade, f"var(--{name})")
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, count=1, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*" height="[^"]*"', r"\1", svg, count=1)
    return re.sub(r"DejaVu Sans|'DejaVu Sans'|&quot;DejaVu Sans&quot;", "var(--sans)", svg)


def own_ids(svg: str, prefix: str) -> str:
    """Put a prefix before every id and every reference to one: a page holds many drawings."""
    svg = re.sub(r'\bid="', f'id="{prefix}', svg)
    return svg.replace('href="#', f'href="#{prefix}').replace("url(#", f"url(#{prefix}")
