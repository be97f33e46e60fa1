# SPDX-License-Identifier: BSD-2-Clause
"""Close matches of misspelt names, for the end of an error message, and names made fit to be shown
and to be files.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable
from functools import lru_cache
from itertools import pairwise

LONGEST = 100
"""Longest name that is compared: the time goes with the square of the length."""

CANDIDATES = 20
"""Names that are compared letter by letter."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Close matches of a misspelt or shortened name as the end of a line, e.g. " (close: J_T,
    J_S)", or nothing.
    """
    if len(name) > LONGEST:
        return ""
    names = [each for each in dict.fromkeys(known) if len(each) <= LONGEST]
    close = (
        difflib.get_close_matches(name, _alike(name, names), n=3)
        or [each for each in names if name in each and len(name) > 2][:3]
    )
    return f" (close: {', '.join(close)})" if close else ""


def _alike(name: str, names: list[str]) -> list[str]:
    """The names that share most pairs of letters with one, relative to their lengths."""
    if len(names) <= CANDIDATES:
        return names
    pairs = _pairs(name)
    score = {each: len(pairs & _pairs(each)) / (len(name) + len(each)) for each in names}
    chosen = set(sorted(score, key=score.__getitem__, reverse=True)[:CANDIDATES])
    return [each for each in names if each in chosen]


@lru_cache(maxsize=100_000)
def _pairs(name: str) -> frozenset[str]:
    """Pairs of neighbouring letters, the margins included."""
    framed = f"^{name}$"
    return frozenset(map("".join, pairwise(framed)))


def printable(text: str) -> str:
    """A text without characters that control a terminal or turn the direction of writing; line
    breaks and tabs stay.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in "\n\t" or not _controls(c) else _escaped(c) for c in text)


def one_line(text: str) -> str:
    """The same for a cell of a table: without line breaks and tabs too."""
    return printable(text).replace("\n", "\\n").replace("\t", "\\t")


def _controls(character: str) -> bool:
    return unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def _escaped(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def file_stem(name: str) -> str:
    """A name as that of a file in the folder at hand: no path, nothing hidden, nothing odd."""
    return re.sub(r"[^\w.-]+", "_", name).lstrip(".-")[:100] or "system"
