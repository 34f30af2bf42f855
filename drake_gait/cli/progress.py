"""Live progress of a search: redrawn in place on a terminal, a line now and then elsewhere."""

import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from drake_gait.report.result import r_squared_line
from drake_gait.search.runner import Progress
from drake_gait.study.settings import StudySettings
from drake_gait.surrogates.ensemble import Surrogate

Clock = Callable[[], float]
"""Tells a time that never goes back [s]."""

_LINES = 20
"""Lines that a whole search prints where it cannot redraw them."""

_REDRAWING = 0.1  # Shortest time between two pictures on a terminal [s].

_SEPARATOR = "   "


class Display(Protocol):
    """Shows a search from `with` to its end, and is called with how far it is."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def __call__(self, progress: Progress) -> None:
        """Show it."""
        ...


def display(
    settings: StudySettings,
    walks: int,
    *,
    console: Console | None = None,
    clock: Clock = time.monotonic,
) -> Display:
    """Return the display of a search for its output: a terminal, or a file or pipe.

    Args:
        settings: What is searched.
        walks: How many walks were done before.
        console: Where it is shown; standard output if None.
        clock: For speed and time left.
    """
    console = console or Console(highlight=False)
    total = settings.search.simulations
    going_on = f", {walks} of them done before" if walks else ""
    console.print(
        f"study {settings.name}, seed {settings.seed}: {total} walks{going_on}", markup=False
    )
    pace = Pace(clock, memory=max(50, 2 * settings.search.batch + 1))
    # Not console.is_terminal: FORCE_COLOR makes that true of files.
    if console.file.isatty() and not console.is_dumb_terminal:
        return _Picture(console, pace, clock)
    return _Lines(console, pace, every=max(1, -(-total // _LINES)))


class Pace:
    """Speed of a search over its latest walks: a search that trains networks is slower than before.

    Args:
        clock: The time [s].
        memory: How many reports back it looks.
    """

    def __init__(self, clock: Clock, *, memory: int) -> None:
        self._clock = clock
        self._reports: deque[tuple[float, int]] = deque(maxlen=memory)

    def note(self, walks: int) -> None:
        """Remember when the search had so many walks."""
        self._reports.append((self._clock(), walks))

    @property
    def speed(self) -> float | None:
        """Walks per second; None before it can be told."""
        if not self._reports:
            return None
        (start, before), (end, after) = self._reports[0], self._reports[-1]
        return (after - before) / (end - start) if end > start and after > before else None


class _Lines:
    """About twenty plain lines, evenly over the walks, and one for where it ended."""

    def __init__(self, console: Console, pace: Pace, *, every: int) -> None:
        self._console, self._pace, self._every = console, pace, every
        self._next = 0
        self._network: Surrogate | None = None
        self._waiting: Progress | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._waiting is not None:
            self._print(self._waiting)

    def __call__(self, progress: Progress) -> None:
        done = progress.walks + progress.confirmations
        self._pace.note(done)
        self._waiting = progress
        if done >= self._next:
            self._print(progress)
            self._next = done - done % self._every + self._every

    def _print(self, progress: Progress) -> None:
        self._waiting = None
        parts = [f"walks {progress.walks}/{progress.total}", *_found(progress)]
        parts += [_speed(self._pace), _left(self._pace, progress), *_failures(progress)]
        if progress.network is not None and progress.network is not self._network:
            self._network = progress.network
            parts.append(f"held-out R² of Z {progress.network.r2_heldout[0]:.2f}")
        self._console.print(_SEPARATOR.join(parts), markup=False, soft_wrap=True)
        self._console.file.flush()


class _Picture:
    """A bar and the numbers below it, redrawn in place."""

    def __init__(self, console: Console, pace: Pace, clock: Clock) -> None:
        self._pace, self._clock = pace, clock
        # Drawn when there is news: a thread of its own would be one more that a signal can meet.
        self._live = Live(console=console, auto_refresh=False)
        self._drawn = float("-inf")
        self._latest: Progress | None = None

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._draw()
        self._live.stop()

    def __call__(self, progress: Progress) -> None:
        self._pace.note(progress.walks + progress.confirmations)
        self._latest = progress
        if self._clock() - self._drawn >= _REDRAWING:
            self._draw()

    def _draw(self) -> None:
        if self._latest is not None:
            self._drawn = self._clock()
            self._live.update(_picture(self._latest, self._pace), refresh=True)


def _picture(progress: Progress, pace: Pace) -> Group:
    bar = Table.grid(expand=True)  # It ends its line; a bar alone does not.
    bar.add_row(ProgressBar(total=progress.total, completed=progress.walks))
    walks = f"walks {progress.walks}/{progress.total}"
    lines = [Text(_SEPARATOR.join([walks, _speed(pace), _left(pace, progress)]))]
    lines.append(Text(_SEPARATOR.join(_found(progress)), style="bold"))
    if failures := _failures(progress):
        lines.append(Text(_SEPARATOR.join(failures), style="yellow"))
    if progress.network is not None:
        lines.append(Text(r_squared_line(progress.network), style="dim"))
    return Group(bar, *lines)


def _found(progress: Progress) -> list[str]:
    best = f"{1e3 * progress.best.walk.forward:.1f} mm" if progress.best else "none yet"
    return [
        f"survivors {progress.survivors}",
        f"feasible {progress.feasible}",
        f"best feasible {best}",
    ]


def _failures(progress: Progress) -> list[str]:
    """Each cause and how often, the frequent ones first."""
    counted = sorted(progress.failures.items(), key=lambda item: (-item[1], item[0]))
    return [f"{cause} {count}" for cause, count in counted]


def _speed(pace: Pace) -> str:
    return "? walks/s" if pace.speed is None else f"{pace.speed:.1f} walks/s"


def _left(pace: Pace, progress: Progress) -> str:
    if progress.confirmations:  # How many it takes is known when they are done.
        return f"confirmations {progress.confirmations}"
    if pace.speed is None:
        return "time left ?"
    minutes, seconds = divmod(round((progress.total - progress.walks) / pace.speed), 60)
    hours, minutes = divmod(minutes, 60)
    clock = f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
    return f"time left {clock}"
