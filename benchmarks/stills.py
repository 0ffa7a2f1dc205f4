"""``python -m benchmarks stills``: edge-watch and edge-report in pictures, as the documentation shows them.

The packaged team of four drives over UDP on this machine, a process a robot, and is watched; the page is of
its logs. Headless Chromium draws both, without a network; ``make chromium`` installs it.
"""

import contextlib
import io
import re
import secrets
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from PIL import Image
from rich.console import Console

import edge_runtime
from benchmarks.common.flags import make_parser
from edge_runtime.common.child import python_command
from edge_runtime.common.command_line import need
from edge_runtime.config.fleet import load_fleet
from edge_runtime.errors import ConfigError, FailedError
from edge_runtime.tools.report import edge_report
from edge_runtime.tools.watch.edge_watch import open_watch
from edge_runtime.tools.watch.view import TeamView

if TYPE_CHECKING:
    from playwright.sync_api import Browser

FOLDER: Final = Path(__file__).parents[1] / "docs" / "pictures"
FLEET: Final = Path(edge_runtime.__file__).parent / "fleets" / "udp.toml"
COLUMNS: Final = 80
WATCHED_S: Final = 6.0
"""When the team is looked at: as it meets in the middle."""
LONGEST_S: Final = 60.0


def main(arguments: Sequence[str]) -> int:
    """Draw the pictures."""
    parser = make_parser("stills", __doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help="where the pictures go")
    out = parser.parse_args(arguments).out
    playwright = need("playwright.sync_api", "test")
    chromium = shutil.which("chromium")
    if chromium is None:
        raise ConfigError("chromium is not installed; run: make chromium")
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, playwright.sync_playwright() as driver:
        folder = Path(name)
        (folder / "edge-watch.html").write_text(f'<body style="margin: 0">{_drive(folder)}')
        logs = map(str, sorted((folder / "logs").iterdir()))
        if edge_report.main([*logs, "-o", str(folder / "report.html")]):
            raise FailedError("the page could not be written, see above")
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        _draw(browser, folder / "edge-watch.html", out / "edge-watch.png", "svg", (1000, 700), "dark")
        _draw(browser, folder / "report.html", out / "report-desktop.png", "", (900, 1950), "light")
        _draw(browser, folder / "report.html", out / "report-phone.png", "", (390, 1700), "dark")
        browser.close()
    return 0


def _drive(folder: Path) -> str:
    """Let the team drive, logs in ``folder``; returns a drawing of how it was watched on the way."""
    path = folder / "team.toml"
    path.write_text(FLEET.read_text().replace("# [watch]\n# address", "[watch]\naddress"))
    (folder / "team.key").write_bytes(secrets.token_bytes(32))
    (folder / "team.key").chmod(0o600)
    fleet = load_fleet(path)
    team, feed = open_watch(fleet, None)
    with feed, _robots(path, [robot.id for robot in fleet.robots]) as robots:
        look_s = time.monotonic() + LONGEST_S
        while time.monotonic() < look_s:
            met = team.all_heard
            feed.wait(0.2)
            team.receive(feed)
            if team.all_heard and not met:
                look_s = time.monotonic() + WATCHED_S
        console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True)
        console.print(TeamView(team, path.name, keys="q ends"))
        for robot in robots:
            if robot.wait():
                raise FailedError("a robot failed, see above")
    drawn = console.export_svg(title=f"edge-watch --fleet {path.name}")
    return re.sub(r"@font-face \{.*?\}", "", drawn, flags=re.DOTALL)  # fonts that would be fetched


@contextlib.contextmanager
def _robots(path: Path, ids: Sequence[int]) -> "Iterator[list[subprocess.Popen[bytes]]]":
    """The team's processes; none outlives this."""
    flags = ("--fleet", path, "--duration", LONGEST_S, "--log-dir", path.parent / "logs")
    commands = [python_command("edge_runtime.run.edge_run", "--robot-id", number, *flags) for number in ids]
    robots = [subprocess.Popen(each, stdout=subprocess.DEVNULL) for each in commands]  # noqa: S603  # ours
    try:
        yield robots
    finally:
        for robot in robots:
            robot.terminate()
            robot.wait()


def _draw(
    browser: "Browser", source: Path, target: Path, part: str, size: tuple[int, int], scheme: str
) -> None:
    """Draw a part of a page, or its upper end."""
    width, height = size
    viewport = {"width": width, "height": height}
    page = browser.new_page(viewport=viewport, color_scheme=scheme)
    page.goto(source.as_uri())
    drawn = page.locator(part).first.screenshot() if part else page.screenshot()
    page.close()
    with Image.open(io.BytesIO(drawn)) as picture:
        picture.convert("RGB").quantize().save(target, optimize=True)
    print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")
