"""Progress of a known number of tasks: a bar on a terminal, a line every few seconds elsewhere."""

import time

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bars

LINE_INTERVAL = 5.0  # s between two lines where there is no terminal


class Count:
    """Reports how much of a known number is done: a bar on a terminal, a line every few seconds elsewhere."""

    def __init__(self, unit: str, quiet: bool = False, console: Console | None = None):
        self._console = console or Console(stderr=True, highlight=False)
        self._quiet = quiet
        self._unit = unit
        self._last_line = self._begin = time.monotonic()
        self._done_before: int | None = None  # number done at the first call: by earlier runs
        self._bars: Bars | None = None

    def __enter__(self) -> "Count":
        if self._console.is_terminal and not self._quiet:
            self._bars = Bars(
                SpinnerColumn(), BarColumn(bar_width=30), TextColumn("{task.fields[text]}"),
                console=self._console, transient=True,
            )  # fmt: skip
            self._task = self._bars.add_task(self._unit, total=None, text=self._unit)
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, done: int, total: int) -> None:
        """Report that `done` of `total` are done."""
        if self._done_before is None:
            self._done_before = done
        now = time.monotonic()
        left = ""
        if done > self._done_before:
            left = f"  about {clock_time((now - self._begin) / (done - self._done_before) * (total - done))} left"
        text = f"{done}/{total} {self._unit}{left if done < total else ''}"
        if self._bars is not None:
            self._bars.update(self._task, completed=done, total=total, text=text)
        elif not self._quiet and now - self._last_line >= LINE_INTERVAL:
            self._last_line = now
            self._console.print(text, soft_wrap=True)


def clock_time(seconds: float) -> str:
    """Return a duration [s] as minutes and seconds, with the hours where there are any."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
