# SPDX-License-Identifier: BSD-2-Clause
"""`harness run --watch`: where a run is while it goes on, on a terminal a table that is renewed,
elsewhere a line per tenth of the run.

It looks at rows that are recorded, between stretches of macro steps: the bits are those of a run
that nobody watches.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.master.progress import Running, Show
from harness.results import derived
from harness.results.result import Result
from harness.spelling import printable

Array = NDArray[np.float64]

SECONDS = 0.25
"""Wall-clock time between two looks on a terminal."""
PARTS = 10
"""Lines of a run where there is no terminal."""
OTHERS = 6
"""Variables shown of a system that has none of the gauges."""


class Gauge(NamedTuple):
    """A quantity of the last row: a variable, or a function of the result that needs some."""

    label: str
    unit: str
    source: str | Callable[[Result], Array]
    needs: tuple[str, ...] = ()
    factor: float = 1.0

    def fits(self, result: Result) -> bool:
        """Whether the result holds what it needs."""
        return result.holds(*((self.source,) if isinstance(self.source, str) else self.needs))

    def text(self, result: Result) -> str:
        """The value, with its name where the variable says what numbers mean."""
        values = result[self.source] if isinstance(self.source, str) else self.source(result)
        value = self.factor * float(np.sum(values[-1]))
        if isinstance(self.source, str) and (name := _name(result.description(self.source), value)):
            return name
        return f"{value:.4g} {self.unit}".rstrip()


def _name(description: str, value: float) -> str:
    """What a number means by a description like `0 coast, 1 align, 2 burn`; "": it does not say."""
    names = dict(re.findall(r"(?:^|, )(\d+) (\w+)", description))
    return names.get(f"{value:g}", "") if re.match(r"0 \w", description) else ""


DEGREES = float(np.degrees(1.0))
PLACES = (derived.SERVICER, derived.TARGET)
GAUGES = (
    Gauge("range", "m", derived.range_, PLACES),
    Gauge("speed", "m/s", derived.relative_speed, derived.VELOCITIES),
    Gauge("position error", "m", derived.position_error, (*PLACES, derived.REFERENCE)),
    Gauge("attitude error", "deg", derived.attitude_error,
          (derived.ATTITUDE, derived.REFERENCE_ATTITUDE), DEGREES),
    Gauge("attitude error", "deg", derived.assembly_attitude_error, derived.ASSEMBLY, DEGREES),
    Gauge("rotation", "deg", "assembly.rotation", factor=DEGREES),
    Gauge("momentum share", "", "assembly.momentum_share"),
    Gauge("pitch", "deg", "robot.pitch", factor=DEGREES),
    Gauge("pitch rate", "deg/s", "robot.pitch_rate", factor=DEGREES),
    Gauge("mode", "", "guidance.mode"),
    Gauge("phase", "", "controller.phase"),
    Gauge("abort", "", "monitor.abort"),
    Gauge("impulse", "N s", "propulsion.impulse"),
)  # fmt: skip


def gauges(result: Result) -> list[Gauge]:
    """Those that fit, else the first variables."""
    fitting = [gauge for gauge in GAUGES if gauge.fits(result)]
    return fitting or [
        Gauge(name, unit if unit != "1" else "", name)
        for name, unit in zip(result.columns[:OTHERS], result.units, strict=False)
    ]


class Look(NamedTuple):
    """What there is to see at one time; factor: simulated by wall-clock time."""

    time: float
    stop: float
    part: float
    factor: float
    values: tuple[tuple[str, str], ...]

    def lines(self) -> Iterator[tuple[str, str]]:
        """Names and values."""
        yield "time", f"{self.time:g} of {self.stop:g} s"
        yield "real time", f"x {self.factor:,.0f}" if self.factor >= 10 else f"x {self.factor:.2g}"
        yield from self.values


class Watcher:
    """Looks at a run now and then."""

    def __init__(self, run: Running) -> None:
        self.run = run
        self.began = perf_counter()
        experiment = run.system.experiment
        self.start, self.step = experiment.start, experiment.step or 0.0

    def look(self, done: int) -> Look:
        """The values of the last row that was recorded."""
        now = _ends(self.run.result())
        seconds = max(perf_counter() - self.began, 1e-9)
        read = [(gauge.label, gauge.text(now)) for gauge in gauges(now)]
        values = tuple((printable(name), printable(v)) for name, v in (*read, *_attitude(now)))
        return Look(
            self.start + done * self.step,
            self.start + self.run.steps * self.step,
            done / max(self.run.steps, 1),
            done * self.step / seconds,
            values,
        )


def _attitude(result: Result) -> Iterator[tuple[str, str]]:
    """Whether the attitude of the servicer is still frozen, where it is at first."""
    release = derived.release_time(result) if derived.ATTITUDE in result else result.time[0]
    if release > result.time[0]:
        yield "attitude", "free" if result.time[-1] >= release else f"frozen until {release:g} s"


def _ends(result: Result) -> Result:
    """The first two rows, by which results.derived knows how rows are aligned, and the last two."""
    rows = len(result.time)
    kept = [0, 1, rows - 2, rows - 1] if rows > 3 else list(range(rows))
    return replace(result, time=result.time[kept], values=result.values[kept])


@contextmanager
def watched(run: Running) -> Iterator[Show]:
    """Watch a run on standard output."""
    if sys.stdout.isatty():
        with _on_terminal(Watcher(run)) as show:
            yield show
    else:
        yield _in_lines(Watcher(run))


def _in_lines(watcher: Watcher) -> Show:
    """A line whenever another part of the run is over."""
    name, due = printable(watcher.run.system.name), 0

    def show(done: int) -> None:
        nonlocal due
        part = done * PARTS // max(watcher.run.steps, 1)
        if part >= due:
            due = part + 1
            look = watcher.look(done)
            words = [f"{label} {value}" for label, value in look.lines()]
            print(f"{name} {100 * look.part:3.0f} %: {', '.join(words)}", flush=True)

    return show


@contextmanager
def _on_terminal(watcher: Watcher) -> Iterator[Show]:
    from rich.console import Console
    from rich.live import Live

    last = 0.0
    with Live(console=Console(file=sys.stdout), auto_refresh=False) as live:

        def show(done: int) -> None:
            nonlocal last
            if done == watcher.run.steps or perf_counter() - last > SECONDS:
                live.update(_table(watcher.run.system.name, watcher.look(done)), refresh=True)
                last = perf_counter()

        yield show


def _table(name: str, look: Look) -> Any:
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True, overflow="ellipsis")
    table.add_column(no_wrap=True, overflow="ellipsis", min_width=24)
    table.add_row(Text(printable(name), "bold"), ProgressBar(1.0, look.part, width=24))
    for label, value in look.lines():
        table.add_row(Text(label), Text(value))
    return table
