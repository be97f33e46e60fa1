# SPDX-License-Identifier: BSD-2-Clause
"""Errors of the harness. Every failure raises one of these classes with a message for the user.

    HarnessError             base class: one line for the user, or a line per problem; status 1
    ├── UsageError           wrong use of the command line or of run(); exit status 2
    ├── ArchiveError         a .ssp or .fmu is damaged or unsafe to unpack
    ├── StructureError       wrong entries in a system or another file; one line per problem
    ├── FmuError             an FMU cannot be read, loaded or instantiated
    ├── RunError             an FMU failed in initialization or in a step; holds the recorded rows
    │   ├── InterruptionError    the user stopped the run
    │   └── RejectedValueError   an FMU rejects values of parameters
    ├── ComparisonError      some runs of a comparison ended early; one line per such run
    ├── RequirementError     requirements are not met; one line each; the results are complete
    └── ResultsError         a results file cannot be written or read

If an error reports several problems, its message has one line per problem. If a library is not
installed, HarnessError itself is raised.
"""

from __future__ import annotations

import errno
from collections.abc import Iterable
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from typing import Any


def reason_of(error: BaseException) -> str:
    """Return the reason that an exception states, as one line of text."""
    text = getattr(error, "strerror", None) or " ".join(str(error).split())
    return text or type(error).__name__


class HarnessError(Exception):
    """Base class of all errors of the harness. str() gives the message for the user."""

    exit_status = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the parts from which pickle rebuilds the error in another process, without the
        partial result.
        """
        return _rebuilt, (type(self), self.args, {**self.__dict__, "partial": None})


def _rebuilt(
    kind: type[HarnessError], args: tuple[Any, ...], about: dict[str, Any]
) -> HarnessError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(about)
    return error


class UsageError(HarnessError):
    """Wrong use of the command line or of a function."""

    exit_status = 2


class ArchiveError(HarnessError):
    """Zip archive that is damaged, or that would write outside of its folder."""


class StructureError(HarnessError):
    """Wrong or contradictory entries of a system, a campaign or another file; `problems`: all of
    them, one line each.
    """

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(dict.fromkeys(problems))
        super().__init__("\n".join(self.problems))


class FmuError(HarnessError):
    """FMU that cannot be read, loaded or instantiated on this machine."""


class RunError(HarnessError):
    """Failure of an FMU in initialization or in a step.

    component, variable: place of the failure (variable is None if the FMU did not name one); time:
    communication point [s]; partial: the Result with the rows recorded before the failure, or None
    if there are none.
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
        """Add a text to the end of the message, after a semicolon."""
        self.args = (f"{self}; {text}",)


class InterruptionError(RunError):
    """Stop of a run by the user."""

    def __init__(self, system: str, time: float) -> None:
        super().__init__(system, time, "interrupted")


class RejectedValueError(RunError):
    """Rejection of parameter values by an FMU; `rejections`: one harness.master.messages.Rejection
    (name, value, violated rule) per value.
    """

    def __init__(self, component: str, time: float, rejections: tuple[Any, ...]) -> None:
        self.rejections = rejections
        super().__init__(component, time, "; ".join(map(str, rejections)))


class ComparisonError(HarnessError):
    """Early end of some runs of a comparison; the message has one line per run that ended early."""


class RequirementError(HarnessError):
    """Requirements that are not met or cannot be evaluated; the message has one line for each.

    partial: the completed Campaign if the error is about a campaign, else None.
    """

    partial: Any = None


class ResultsError(HarnessError):
    """Output that cannot be written; result or dataset that is unreadable or lacks a part."""


# ---- libraries that only some commands need

EXTRAS = {
    "plot": ("matplotlib", "scipy"),
    "report": ("jinja2", "k3d", "plotly"),
    "campaign": ("zarr",),
    "notebook": ("pandas", "xarray"),
    "exchange": ("astropy", "erfa", "oem", "sgp4"),
    "python": ("pythonfmu",),
    "learn": ("gymnasium",),
    "live": ("ziglang",),
    "verify": ("cma", "threadpoolctl"),
}
"""Libraries that some extras of this package install: `pip install servicing-fmus[EXTRA]`."""
HOMES = {"erfa": "pyerfa"}
"""Name of the package to install, by name of the module, where the two names differ."""


def library(name: str, extra: str) -> Any:
    """Import and return the module `name`; raise HarnessError if it is not installed.

    extra: extra of this package that installs the module.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise HarnessError(_needed(name.partition(".")[0], extra)) from error


def installed(name: str, extra: str) -> ModuleSpec:
    """Return the specification (with the location) of the module `name` without importing it; raise
    HarnessError if it is not installed.

    extra: extra of this package that installs the module.
    """
    if (found := find_spec(name)) is None:
        raise HarnessError(_needed(name, extra))
    return found


_MEMORY = "memory", "RLIMIT_AS", "ulimit -v", 1024
_FILES = "the number of open files", "RLIMIT_NOFILE", "ulimit -n", 1
_LIMITS: dict[Any, tuple[str, str, str, int]] = {
    **dict.fromkeys((errno.ENOMEM, MemoryError), _MEMORY),
    **dict.fromkeys(("new thread", "map segment", "allocate memory"), _MEMORY),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), _FILES),
}
"""Exhausted resources of the machine, by a sign in an error: an errno, a class of exceptions, or a
part of the message. Values: the resource, the name of its limit in the Python module `resource`,
the shell command that prints the limit, and the number by which a limit of `resource` is divided to
give the number that this command prints.
"""


def exhausted(error: BaseException | None) -> str | None:
    """Return a line that names the exhausted resource of the machine (memory, open files) and its
    limit, if this caused the error or one of its causes; otherwise None.
    """
    while error is not None:
        signs = getattr(error, "errno", None), type(error)
        about = next((_LIMITS[sign] for sign in signs if sign in _LIMITS), None)
        texts = (sign for sign in _LIMITS if isinstance(sign, str) and sign in str(error))
        if about := about or _LIMITS.get(next(texts, None)):
            return _limit(*about)
        error = error.__cause__ or error.__context__
    return None


def _limit(name: str, kind: str, command: str, unit: int) -> str:
    try:
        import resource
    except ImportError:  # Windows
        return f"{name} is exhausted"
    limit = resource.getrlimit(getattr(resource, kind))[0]
    value = "unlimited" if limit == resource.RLIM_INFINITY else limit // unit
    return f"{name} is exhausted: close other programs or raise the limit ({command}: {value})"


def missing(error: ModuleNotFoundError) -> str | None:
    """Return a line with the command that installs a missing module; None if EXTRAS lacks it."""
    name = (error.name or "").partition(".")[0]
    extra = next((extra for extra, names in EXTRAS.items() if name in names), None)
    return None if extra is None else _needed(name, extra)


def _needed(name: str, extra: str) -> str:
    package = HOMES.get(name, name)
    return f"this needs the library {package}: pip install 'servicing-fmus[{extra}]'"
