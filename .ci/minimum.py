# SPDX-License-Identifier: BSD-2-Clause
"""Print the oldest versions that pyproject.toml accepts of all dependencies and the extra `test`,
which includes `all`, as requirements for pip: for the nightly run (lab/minimum.md describes one).
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"


def minimum(requirement: str) -> str:
    """Return `numpy==1.26` for `numpy>=1.26`, others as they are."""
    found = re.match(r"([\w.\[\]-]+)>=([\d.]+)", requirement)
    return f"{found[1]}=={found[2]}" if found else requirement


def requirements(project: dict[str, object], extra: str) -> list[str]:
    """Return the requirements of an extra and of the extras that it names."""
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
