"""The view on a terminal: drawn on the alternate screen, ended by q, the terminal left as it was found."""

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from typing import Final

from rich.console import Console
from rich.live import Live

from edge_runtime.tools.watch.feed import Feed
from edge_runtime.tools.watch.team import WatchedTeam
from edge_runtime.tools.watch.view import TeamView

REFRESH_S: Final = 0.2
QUIT: Final = b"qQ\x03\x04"


def watch_on_screen(team: WatchedTeam, feed: Feed, title: str, ended: Callable[[], bool]) -> None:
    """Show the team until q is typed or ``ended`` says so."""
    console = Console()
    view = TeamView(team, title, keys="q ends")
    keyboard = sys.stdin.fileno() if sys.stdin is not None and sys.stdin.isatty() else None
    with _single_keys(keyboard), Live(view, console=console, screen=True, auto_refresh=False) as live:
        while not ended() and not _quit(keyboard):
            team.receive(feed)
            live.refresh()


def _quit(keyboard: int | None) -> bool:
    """Wait for the next refresh; whether a key that ends was typed meanwhile."""
    ready, _, _ = select.select([] if keyboard is None else [keyboard], [], [], REFRESH_S)
    if not ready or keyboard is None:
        return False
    typed = os.read(keyboard, 64)
    return not typed or any(key in QUIT for key in typed)


@contextlib.contextmanager
def _single_keys(keyboard: int | None) -> Iterator[None]:
    """Let keys arrive at once and unseen."""
    if keyboard is None:
        yield
        return
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard)
    try:
        yield
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
