# SPDX-License-Identifier: BSD-2-Clause
"""Pages of the Python API: public names, which mkdocstrings replaces by their docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from importlib import import_module
from typing import Any

PACKAGES = {
    "harness": ("python.md", "Python: run and read", "`from harness import run, load, ...`"),
    "harness.mission": (
        "python_missions.md",
        "Python: missions",
        "What `mission.py` imports: `from harness.mission import Mission, ...`",
    ),
    "harness.errors": (
        "python_errors.md",
        "Python: errors",
        "Exceptions of public functions derive from `HarnessError`. A name that a result does not "
        "have raises `KeyError`.",
    ),
}


def names(package: str) -> list[str]:
    """Return the public names of a package, except its version and names on another page."""
    module = import_module(package)
    listed = getattr(module, "__all__", None) or [
        name for name, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == package and name[0] != "_"
    ]  # fmt: skip
    own = [name for name in listed if name != "__version__"]
    other = set(PACKAGES) - {package}
    return [name for name in own if getattr(module, name).__module__ not in other]


def home(package: str, name: str) -> str:
    """Return the dotted path where a public name is defined."""
    found: Any = getattr(import_module(package), name)
    return f"{found.__module__}.{found.__qualname__}"


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and text of the pages of the Python reference."""
    for package, (file, title, text) in PACKAGES.items():
        extra = [CHANGES] if package == "harness" else []
        listed = [home(package, name) for name in names(package)] + extra
        body = "\n\n".join(f"::: {name}" for name in listed)
        yield f"reference/{file}", f"# {title}\n\n{text}\n\n{body}\n"


CHANGES = "harness.master.changes.Changes"
"""Dotted path of the class that defines the keyword arguments of run() and Simulation."""
