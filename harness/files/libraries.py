# SPDX-License-Identifier: BSD-2-Clause
"""Libraries that only some need, and one line where they are missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from harness.errors import HarnessError

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
