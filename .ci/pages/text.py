# SPDX-License-Identifier: BSD-2-Clause
"""Pieces of Markdown: tables, and links of the repository turned into links of the site."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s#]+)?(#[^)\s]*)?(\))")
FENCE = re.compile(r"^(```.*?^```|(?: {4}[^\n]*\n?)+)", re.MULTILINE | re.DOTALL)


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines) + "\n"


def cell(text: str) -> str:
    """Return a text as one line with escaped separators, for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|") or " "


def between(page: str, target: str) -> str:
    """Return the relative link from a page of the site to another file of the site."""
    return os.path.relpath(target, PurePosixPath(page).parent).replace(os.sep, "/")


def counted(kind: str, names: Iterable[str]) -> Iterator[str]:
    """Yield the names; before each, print a line with its number: `live page 5 of 9: NAME`."""
    every = list(names)
    for k, name in enumerate(every, start=1):
        print(f"{kind} {k} of {len(every)}: {name}", flush=True)
        yield name


def relinked(text: str, source: str, page: str, homes: Mapping[str, str]) -> str:
    """Return a page of the repository with its links turned into links of the site.

    source: path of the page in the repository; page: its path in the site; homes: mapping from a
    file of the repository to the page of the site that shows this file. Raise ValueError for a link
    to a file outside docs/ that the site does not show.
    """

    def new(found: re.Match[str]) -> str:
        opening, target, place, closing = found.groups(default="")
        if not target or re.match(r"[a-z]+:", target):
            return found[0]
        path = os.path.normpath(PurePosixPath(source).parent / target).replace(os.sep, "/")
        if path not in homes and path.startswith("docs/"):
            return found[0]  # mkdocs reports the link if no page is generated later
        if path not in homes:
            raise ValueError(f"{source}: the site has no page for the link to {target}")
        return f"{opening}{between(page, homes[path])}{place}{closing}"

    parts = FENCE.split(text)  # parts at odd indices are code and stay unchanged
    return "".join(part if i % 2 else LINK.sub(new, part) for i, part in enumerate(parts))
