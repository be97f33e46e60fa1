"""System in, result out: the public function, and its three parts for those who want to do
something in between.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from harness import paths, ssp
from harness.errors import UsageError, did_you_mean
from harness.master import Simulation
from harness.overrides import Pairs, apply
from harness.results import Result
from harness.system import System


def run(  # noqa: PLR0913 - every one is an option of the command line
    system: str | Path | System,
    *,
    params: str | Path | None = None,
    set: Pairs = (),
    swap: Pairs = (),
    latency: Pairs = (),
    step: float | None = None,
    stop: float | None = None,
    algorithm: str | None = None,
    executor: str = "c",
    every: int = 1,
    progress: bool = False,
) -> Result:
    """Fly a system and return what was recorded.

    system: name of a system of the project, path of an .ssp, or a System;
    params: name of one of its parameter sets, or a .toml or .ssv file; set:
    `component.parameter=value` (numbers, lists, lists of lists), as texts or a mapping; swap:
    `component=fmu` (name or path), likewise; latency: `component=N`, its outputs come N macro steps
    later; step: macro step [s]; stop: stop time [s], a multiple of it; algorithm: gauss-seidel or
    jacobi; executor: c or python (same bits); every: record every N-th macro step; progress: show a
    bar on stderr.

    Raises UsageError, ArchiveError, StructureError, FmuError, or RunError, whose `partial` is what
    was recorded so far.
    """
    with loaded(system) as found:
        changed = apply(
            found,
            params=params,
            set=set,
            swap=swap,
            latency=latency,
            step=step,
            stop=stop,
            algorithm=algorithm,
        )
        return fly(changed, executor=executor, every=every, progress=progress)


@contextmanager
def loaded(system: str | Path | System) -> Iterator[System]:
    """The system of that name or path; its FMUs are unpacked until the end of the `with` block."""
    if isinstance(system, System):
        yield system
        return
    with ssp.opened(find_system(system)) as found:
        yield found


def find_system(name: str | Path) -> Path:
    """Path of an .ssp by name or path; UsageError with close matches if there is none."""
    known = paths.systems()
    if str(name) in known:
        return known[str(name)]
    if Path(name).is_file():
        return Path(name)
    raise UsageError(f"{name}: there is no such system{did_you_mean(str(name), known)}")


def fly(system: System, *, executor: str = "c", every: int = 1, progress: bool = False) -> Result:
    """Run a system as it is; the arguments are those of run()."""
    with Simulation(system, executor=executor, every=every) as simulation:
        with progress_bar(system.name, simulation.steps, progress) as show:
            simulation.advance(progress=show)
        return simulation.result()


@contextmanager
def progress_bar(title: str, total: int, wanted: bool) -> Iterator[Callable[[int], None] | None]:
    """A bar on stderr that vanishes at the end, as a function of the number of macro steps done;
    None if unwanted.
    """
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
