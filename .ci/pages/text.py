# SPDX-License-Identifier: BSD-2-Clause
"""Pieces of Markdown: tables, and links of the repository turned into those of the site."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)?(#[^)\s]*)?(\))")
FENCE = re.compile(r"^(```.*?^```|(?: {4}[^\n]*\n?)+)", re.MULTILINE | re.DOTALL)


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines) + "\n"


def cell(text: str) -> str:
    """A text that stays in its cell."""
    return " ".join(text.split()).replace("|", "\\|") or " "


def between(page: str, target: str) -> str:
    """The link from one page of the site to another file of it."""
    return os.path.relpath(target, PurePosixPath(page).parent).replace(os.sep, "/")


def relinked(text: str, source: str, page: str, homes: Mapping[str, str]) -> str:
    """A page of the repository with the links that it has in the site.

    source: its path in the repository; page: in the site; homes: pages of the site by the file of
    the repository that they show. ValueError for a link to something that the site does not show.
    """

    def new(found: re.Match[str]) -> str:
        opening, target, place, closing = found.groups(default="")
        if not target or re.match(r"[a-z]+:", target):
            return found[0]
        path = os.path.normpath(PurePosixPath(source).parent / target).replace(os.sep, "/")
        if path not in homes and path.startswith("docs/"):
            return found[0]  # a generated page; mkdocs looks whether it is there
        if path not in homes:
            raise ValueError(f"{source}: the link to {target} leads out of the site")
        return f"{opening}{between(page, homes[path])}{place}{closing}"

    parts = FENCE.split(text)  # code stands at the odd places
    return "".join(part if i % 2 else LINK.sub(new, part) for i, part in enumerate(parts))
