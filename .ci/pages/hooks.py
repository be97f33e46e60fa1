# SPDX-License-Identifier: BSD-2-Clause
"""Hook of mkdocs that replaces "folder/*.md" in the navigation by the pages of the folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def on_config(config: Any) -> Any:
    """Expand "folder/*.md" in the navigation of the configuration; mkdocs calls this function."""
    config["nav"] = _expanded(config["nav"], Path(config["docs_dir"]))
    return config


def _expanded(entry: Any, docs: Path) -> Any:
    if isinstance(entry, dict):
        return {title: _expanded(each, docs) for title, each in entry.items()}
    if isinstance(entry, str):
        return entry
    found: list[Any] = []
    for each in entry:
        if isinstance(each, str) and "*" in each:
            pages = sorted(p for p in docs.glob(each) if p.name != "index.md")
            index = [p for p in docs.glob(each) if p.name == "index.md"]
            found += [p.relative_to(docs).as_posix() for p in index + pages]
        else:
            found.append(_expanded(each, docs))
    return found
