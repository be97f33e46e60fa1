# SPDX-License-Identifier: BSD-2-Clause
"""Print requirements for pip: the oldest version that pyproject.toml accepts of every dependency,
including the dependencies of the extra `test`, which contains the extra `all`. The nightly workflow
runs the tests with these versions (lab/minimum.md).
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def minimum(requirement: str) -> str:
    """Return `numpy==1.26` for `numpy>=1.26`, and requirements of another form unchanged."""
    found = re.match(r"([\w.\[\]-]+)>=([\d.]+)", requirement)
    return f"{found[1]}=={found[2]}" if found else requirement


def requirements(project: dict[str, object], extra: str) -> list[str]:
    """Return the requirements of an extra, where `servicing-fmus[NAME]` is replaced by the
    requirements of the extra NAME. project: table [project] of pyproject.toml.
    """
    extras: dict[str, list[str]] = project["optional-dependencies"]  # type: ignore[assignment]
    found = []
    for each in extras[extra]:
        named = re.fullmatch(r"servicing-fmus\[(.*)\]", each)
        found += (
            [r for n in named[1].split(",") for r in requirements(project, n)] if named else [each]
        )
    return found


if __name__ == "__main__":
    table = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    print(
        "\n".join(
            map(minimum, dict.fromkeys([*table["dependencies"], *requirements(table, "test")]))
        )
    )
