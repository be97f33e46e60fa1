# SPDX-License-Identifier: BSD-2-Clause
"""Libraries that only some need, and one line where they are missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from harness.errors import HarnessError

HOMES = {"erfa": "pyerfa"}
"""Distribution of a module where it has another name."""


def library(name: str, extra: str) -> Any:
    """A module of an extra of this package; HarnessError if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        wanted = HOMES.get(name, name.partition(".")[0])
        raise HarnessError(
            f"this needs the library {wanted}: pip install 'servicing-fmus[{extra}]'"
        ) from error
