# SPDX-License-Identifier: BSD-2-Clause
"""Every way in which the harness can fail: what is raised is always one of these, and its text is
for the user.

    HarnessError             what the user reads as one line, or a line per problem; status 1
    ├── UsageError           wrong use of the command line or of run(); exit status 2
    ├── ArchiveError         a .ssp or .fmu is damaged or unsafe to unpack
    ├── StructureError       a system contradicts itself; carries all problems, one line each
    ├── FmuError             an FMU cannot be read, loaded or instantiated
    ├── RunError             an FMU failed in initialization or in a step; carries the rows so far
    │   ├── InterruptionError    the user stopped the run
    │   └── RefusalError         an FMU refuses values of parameters
    ├── ComparisonError      runs of a comparison ended early, a line each; the others are complete
    ├── RequirementError     requirements are not met, a line each; the results are complete
    └── ResultsError         a results file cannot be written or read

Several problems are several lines of one text. A library that is missing is one line too.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any


def reason_of(error: BaseException) -> str:
    """Why something failed, in a line."""
    text = getattr(error, "strerror", None) or " ".join(str(error).split())
    return text or type(error).__name__


class HarnessError(Exception):
    """Root of the tree; str() is the message for the user."""

    exit_status = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """For the way to another process: as it is, whatever its arguments were; no results."""
        return _rebuilt, (type(self), self.args, {**self.__dict__, "partial": None})


def _rebuilt(
    kind: type[HarnessError], args: tuple[Any, ...], about: dict[str, Any]
) -> HarnessError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(about)
    return error


class UsageError(HarnessError):
    """The request is not valid."""

    exit_status = 2


class ArchiveError(HarnessError):
    """A zip archive is damaged, or unpacking it would write where it must not."""


class StructureError(HarnessError):
    """A system contradicts itself; `problems` holds all of them, one line each."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(dict.fromkeys(problems))
        super().__init__("\n".join(self.problems))


class FmuError(HarnessError):
    """An FMU cannot be read, loaded or instantiated on this machine."""


class RunError(HarnessError):
    """An FMU failed while the system was being initialised or stepped.

    component, variable: where (variable is None if the FMU did not say); time: communication point
    [s]; partial: the Result with everything recorded before the failure, or None if there is
    nothing.
    """

    def __init__(
        self, component: str, time: float, message: str, variable: str | None = None
    ) -> None:
        self.component = component
        self.variable = variable
        self.time = time
        self.message = " ".join(message.split())
        self.partial: Any = None
        place = component if variable is None else f"{component}.{variable}"
        super().__init__(f"{place}: {self.message} (at t = {time:.12g} s)")

    def append(self, text: str) -> None:
        """Add something to the end of the line."""
        self.args = (f"{self}; {text}",)


class InterruptionError(RunError):
    """The user stopped the run."""

    def __init__(self, system: str, time: float) -> None:
        super().__init__(system, time, "interrupted")


class RefusalError(RunError):
    """An FMU refuses values of its parameters; `refusals` holds the rules that are broken, see
    harness.master.refusals.
    """

    def __init__(self, component: str, time: float, refusals: tuple[Any, ...]) -> None:
        self.refusals = refusals
        super().__init__(component, time, "; ".join(map(str, refusals)))


class ComparisonError(HarnessError):
    """Some runs of a comparison ended early; one line each."""


class RequirementError(HarnessError):
    """Requirements are not met or cannot be evaluated; one line each.

    partial: the Campaign whose success cannot be evaluated, else None.
    """

    partial: Any = None


class ResultsError(HarnessError):
    """A results file cannot be written or read."""


# ---- libraries that only some need

EXTRAS = {
    "plot": ("matplotlib", "scipy"),
    "report": ("jinja2", "k3d", "plotly", "trimesh"),
    "campaign": ("zarr",),
    "cluster": ("cryptography", "dask", "distributed"),
    "notebook": ("pandas", "xarray"),
    "exchange": ("astropy", "erfa", "oem", "pyarrow", "sgp4"),
    "python": ("pythonfmu",),
}
"""Extras of this package and the libraries that each brings."""
HOMES = {"erfa": "pyerfa"}
"""Distribution of a module where it has another name."""


def library(name: str, extra: str) -> Any:
    """A module of an extra of this package; HarnessError if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise HarnessError(_needed(name.partition(".")[0], extra)) from error


def missing(error: ModuleNotFoundError) -> str | None:
    """One line that says how to install what is missing; None if no extra brings it."""
    name = (error.name or "").partition(".")[0]
    extra = next((extra for extra, names in EXTRAS.items() if name in names), None)
    return None if extra is None else _needed(name, extra)


def _needed(name: str, extra: str) -> str:
    wanted = HOMES.get(name, name)
    return f"this needs the library {wanted}: pip install 'servicing-fmus[{extra}]'"
