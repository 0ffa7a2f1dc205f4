"""What edge-train shows while it works: a bar on a terminal, lines anywhere else."""

import sys
import time

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from export.training.metrics import MetricsRow


class ProgressView:
    """Shows training rows of a run of ``total`` frames that begins at frame ``done``."""

    def __init__(self, done: int, total: int, failure: str) -> None:
        self._first, self._total, self._failure = done, total, failure
        self._started = time.monotonic()
        self._validated = "not validated yet"
        self._bar: Progress | None = None
        if sys.stdout.isatty():
            self._bar = Progress(
                TextColumn("{task.percentage:3.0f} %"),
                BarColumn(bar_width=20),
                TextColumn("{task.description}"),
                TimeRemainingColumn(),
                refresh_per_second=4,
            )
            self._task = self._bar.add_task("starting", total=total, completed=done)

    def __enter__(self) -> "ProgressView":
        """Begin to show."""
        if self._bar:
            self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the terminal as it was."""
        if self._bar:
            self._bar.stop()

    def show(self, row: MetricsRow) -> None:
        """Show where training stands."""
        if row.validation_success is not None:
            self._validated = f"validated {_percent(row.validation_success)}"
            if row.guided_success is not None:
                self._validated += f", guided {_percent(row.guided_success)}"
        text = (
            f"return {_number(row.mean_return)}  success {_percent(row.success)}  "
            f"{self._failure}s {_percent(row.failure)}  {self._validated}"
        )
        if self._bar:
            self._bar.update(self._task, completed=row.frames, description=text)
        else:
            share = row.frames / self._total
            print(f"{share:4.0%}  {row.frames} frames  {text}  {self._time_left(row.frames)}", flush=True)

    def _time_left(self, frames: int) -> str:
        per_frame = (time.monotonic() - self._started) / max(frames - self._first, 1)
        minutes, seconds = divmod(round(per_frame * (self._total - frames)), 60)
        return f"{minutes}:{seconds:02d} left"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.1%}"
