# SPDX-License-Identifier: BSD-2-Clause
"""Run systems of FMUs with fixed macro steps.

>>> from harness import run
>>> result = run("sync_approach", set=["servicer.mass_0=120"])
>>> result["servicer.r_SN_N"].shape
(18001, 3)

The public names (`harness.run`, ...) are imported on first use, so that `import harness` is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.api import compare as compare
    from harness.api import environment as environment
    from harness.api import linearize as linearize
    from harness.api import run as run
    from harness.authoring.build import build as build
    from harness.authoring.export import export as export
    from harness.errors import HarnessError as HarnessError
    from harness.master.simulation import Simulation as Simulation
    from harness.results.files import read as read
    from harness.results.result import Result as Result
    from harness.ssp.library import load as load
    from harness.studies.analyses.evaluator import Evaluator as Evaluator
    from harness.studies.analyses.sensitivity import sensitivity as sensitivity
    from harness.studies.analyses.worst import worst as worst
    from harness.studies.campaign.campaign import campaign as campaign
    from harness.studies.show import show as show

__version__ = "0.1.0"

_HOMES = {
    "Evaluator": "harness.studies.analyses.evaluator",
    "HarnessError": "harness.errors",
    "Result": "harness.results.result",
    "Simulation": "harness.master.simulation",
    "build": "harness.authoring.build",
    "campaign": "harness.studies.campaign.campaign",
    "compare": "harness.api",
    "environment": "harness.api",
    "export": "harness.authoring.export",
    "linearize": "harness.api",
    "load": "harness.ssp.library",
    "read": "harness.results.files",
    "run": "harness.api",
    "sensitivity": "harness.studies.analyses.sensitivity",
    "show": "harness.studies.show",
    "worst": "harness.studies.analyses.worst",
}
"""Module in which each public name is defined."""

__all__ = [*_HOMES, "__version__"]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Return a public name, imported on first use."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import_module("harness.api")  # adds the methods plot, save and report to Result
    return getattr(import_module(_HOMES[name]), name)
