# SPDX-License-Identifier: BSD-2-Clause
"""The archive of an FMU beside its description: what lies where (FMI 2.0, 2.3)."""

from __future__ import annotations

from collections.abc import Iterator

from harness.rules.description import Description

ROOT = (
    "modelDescription.xml",
    "model.png",
    "documentation",
    "licenses",
    "sources",
    "binaries",
    "resources",
    "extra",
    "terminalsAndIcons",
)
"""What may lie at the top of the archive."""


def stray_files(d: Description) -> Iterator[str]:
    """Nothing but what the standard names lies at the top."""
    tops = dict.fromkeys(name.partition("/")[0] for name in d.files)
    yield from (f"{top}: has no place at the top of the archive" for top in tops if top not in ROOT)


def missing_sources(d: Description) -> Iterator[str]:
    """Every source file that is listed is there."""
    there = set(d.files)
    for name in dict.fromkeys(e.get("name") for e in d.all("*/SourceFiles/File")):
        if f"sources/{name}" not in there:
            yield f"the source file sources/{name} is listed, but not in the archive"
