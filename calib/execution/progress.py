"""Progress of a known number of tasks: a bar on a terminal, a line every few seconds elsewhere."""

import time
from bisect import bisect_right

from rich.console import Console
from rich.progress import BarColumn, SpinnerColumn, TextColumn
from rich.progress import Progress as Bars

LINE_INTERVAL = 5.0  # s between two lines where there is no terminal


class Count:
    """Reports how much of a known number is done: a bar on a terminal, a line every few seconds elsewhere.

    The time left is told by the pace of the later half of what was done: what it takes to begin with does not count.
    """

    def __init__(self, unit: str, quiet: bool = False, console: Console | None = None):
        self._console = console or Console(stderr=True, highlight=False)
        self._quiet = quiet
        self._unit = unit
        self._last_line = time.monotonic()
        self._times = list[float]()  # of the calls that told of more  [s]
        self._dones = list[int]()  # that they told of; the first: what earlier runs have done
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
        now = time.monotonic()
        left = ""
        if self._dones and done > self._dones[0]:
            half = bisect_right(self._dones, (self._dones[0] + done) // 2) - 1
            pace = (now - self._times[half]) / (done - self._dones[half])
            left = f"  about {clock_time(pace * (total - done))} left"
        if not self._dones or done > self._dones[-1]:
            self._times.append(now)
            self._dones.append(done)
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
