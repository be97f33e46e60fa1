# SPDX-License-Identifier: BSD-2-Clause
"""Page of the papers behind the models, from CITATION.cff."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from text import ROOT

HEAD = """# Papers

Cite this software and the work behind the model that you use. The same list, for reference
managers: `CITATION.cff`. The printed papers contain errors; parts A, B, D and E of
[the equations](../models.md) list the corrections.

"""


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and text of the page."""
    import yaml

    file = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    yield "reference/papers.md", HEAD + "".join(map(line, file["references"]))


def line(work: Mapping[str, Any]) -> str:
    """Return the list item of one reference in Markdown; work: its entry in CITATION.cff."""
    authors = ", ".join(f"{a['family-names']} {a['given-names']}" for a in work["authors"])
    place = work.get("journal") or work.get("collection-title") or work.get("number", "")
    volume = f" {work['volume']}" if "volume" in work else ""
    issue = f"({work['issue']})" if "issue" in work else ""
    span = f", {work['start']}-{work['end']}" if "start" in work else ""
    doi = f" doi:{work['doi']}." if "doi" in work else ""
    return (
        f"* {authors}: *{work['title']}*. {place}{volume}{issue}, {work['year']}{span}.{doi}"
        f" For: {work['notes']}.\n"
    )
