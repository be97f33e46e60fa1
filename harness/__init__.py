# SPDX-License-Identifier: BSD-2-Clause
"""Run systems of FMUs with fixed macro steps.

>>> from harness import run
>>> result = run("sync_approach", set=["servicer.mass_0=120"])
>>> result["servicer.r_SN_N"].shape
(18001, 3)

The names below are imported when they are first used, so that `import harness` is quick.
"""

# ruff: noqa: F403, F405 - for type checkers harness.api lists what it offers

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.api import *
    from harness.errors import HarnessError

    __version__: str

_HOMES = {"HarnessError": "harness.errors"}
"""Modules of the public names that do not come from harness.api."""

__all__ = [
    "Flights",
    "HarnessError",
    "Result",
    "Simulation",
    "__version__",
    "boundary",
    "build",
    "campaign",
    "compare",
    "export",
    "linearize",
    "load",
    "probability",
    "read",
    "run",
    "sensitivity",
    "show",
    "tune",
    "worst",
]


def __getattr__(name: str) -> Any:
    """The public names, on first use."""
    if name == "__version__":
        from importlib.metadata import version

        return version("servicing-fmus")
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES.get(name, "harness.api")), name)
