# SPDX-License-Identifier: BSD-2-Clause
"""The processors that firmware can be built for: those of targets.toml, and whether their tools are
at hand.
"""

from __future__ import annotations

import shutil
import subprocess
import tomllib
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from harness.errors import UsageError
from harness.spelling import did_you_mean

SPECS = "picolibc.specs"
"""Of the C library, with start-up code and linker script."""


class Target(NamedTuple):
    """A processor; its entries are explained in targets.toml."""

    name: str
    text: str
    tools: str
    flags: tuple[str, ...]
    flash: tuple[int, int]
    ram: tuple[int, int]
    emulator: tuple[str, ...]
    packages: str
    clock: float

    @property
    def compiler(self) -> str:
        """Its gcc."""
        return f"{self.tools}gcc"


def _target(name: str, entries: dict[str, Any]) -> Target:
    words = {key: tuple(entries[key].split()) for key in ("flags", "emulator")}
    places = {key: tuple(entries[key]) for key in ("flash", "ram")}
    return Target(name, **{**entries, **words, **places})


_FILE = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")

TARGETS = {name: _target(name, entries) for name, entries in tomllib.loads(_FILE).items()}


def find_target(name: str) -> Target:
    """The processor of that name, with its tools at hand; UsageError that says what is missing."""
    if name not in TARGETS:
        near, known = did_you_mean(name, TARGETS), ", ".join(TARGETS)
        raise UsageError(f"{name}: there is no such processor{near}; {known}")
    if lacking := missing(TARGETS[name]):
        raise UsageError(lacking)
    return TARGETS[name]


def missing(target: Target) -> str:
    """What a machine lacks for a processor, as one line; "" if it lacks nothing."""
    tools = (target.compiler, f"{target.tools}objcopy", target.emulator[0])
    lacking = [tool for tool in tools if shutil.which(tool) is None]
    if target.compiler not in lacking and not _has_library(target):
        lacking.append(f"picolibc of {target.compiler}")
    if not lacking:
        return ""
    get = f"make pil, or apt-get install {target.packages}"
    return f"{target.name} needs {' and '.join(lacking)}: {get}"


@cache
def _has_library(target: Target) -> bool:
    """A gcc that does not find its specs gives their name back."""
    command = [target.compiler, f"-print-file-name={SPECS}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return found != SPECS
