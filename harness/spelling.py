# SPDX-License-Identifier: BSD-2-Clause
"""Functions for texts in messages and tables: close matches of misspelt names, texts without
control characters, names of files, numbers, columns.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

LONGEST = 100
"""Largest length of a name that is compared with known names [characters], because the time of a
comparison grows with the square of the length.
"""

CANDIDATES = 20
"""Number of names before and after the misspelt name, in each of two sorted lists, that are
compared letter by letter.
"""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return close matches of a misspelt or shortened name as the end of a message, such as
    " (close: J_T, J_S)"; "" if there are none.
    """
    if len(name) > LONGEST:
        return ""
    names = tuple(known)
    near = dict.fromkeys(_neighbours(name, names))
    close = (
        difflib.get_close_matches(name, near, n=3)
        or [each for each in dict.fromkeys(names) if name in each and len(name) > 2][:3]
    )
    return f" (close: {', '.join(close)})" if close else ""


def _neighbours(name: str, known: tuple[str, ...]) -> Iterator[str]:
    """Yield the known names that are near `name` in alphabetical order, or in the alphabetical
    order of the names spelled backwards. A known name that differs in one letter is usually near in
    one of the two orders, so few of many thousands of names need to be compared.
    """
    beginnings, ends = _ordered(known)
    at, end = bisect(beginnings, name), bisect(ends, name[::-1])
    yield from beginnings[max(0, at - CANDIDATES) : at + CANDIDATES]
    yield from (each[::-1] for each in ends[max(0, end - CANDIDATES) : end + CANDIDATES])


@lru_cache(maxsize=8)
def _ordered(known: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Return two lists: the names in alphabetical order, and the names spelled backwards in
    alphabetical order.
    """
    names = [each for each in known if len(each) <= LONGEST]
    return sorted(names), sorted(each[::-1] for each in names)


SHOWN = 5
"""Largest number of things that a message lists."""


def some(things: Sequence[object]) -> str:
    """Return a text that lists the first SHOWN of several things and the number of all others."""
    more = f" and {len(things) - SHOWN} more" if len(things) > SHOWN else ""
    return f"{', '.join(map(str, things[:SHOWN]))}{more}"


def first_error(text: str) -> str:
    """Return the first error line in the output of a compiler, without names of folders, or the
    last line of the traceback of a Python program. Lines of collect2, which only report that the
    linker failed, are skipped.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    lines = lines or ["the compiler gives no reason"]
    if "Traceback (most recent call last):" in text:
        return printable(lines[-1])
    wrong = re.compile(r"(?!collect2).*(\berror:|undefined|multiple definition)")
    found = filter(wrong.match, lines)
    return printable(re.sub(r"(?<!\S)\S*/(?=\S)", "", next(found, lines[0])))


def printable(text: str) -> str:
    """Return a text in which characters that control a terminal or reverse the writing direction
    are replaced by their codes. Line breaks and tabs remain.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(map(_harmless, text))


def one_line(text: str) -> str:
    """Return printable text for a cell of a table, without line breaks and tabs."""
    return printable(text).replace("\n", "\\n").replace("\t", "\\t")


def _harmless(character: str) -> str:
    """Return a character, or its hexadecimal escape code if it is a control character."""
    is_control = unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    if character in "\n\t" or not is_control:
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def file_stem(name: str) -> str:
    """Return a name changed into a safe file name: no path, not hidden, no special characters, at
    most 100 characters.
    """
    return re.sub(r"[^\w.-]+", "_", name).lstrip(".-")[:100] or "system"


def is_number(text: str) -> bool:
    """Return whether a text can be read as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def number(value: Any) -> str:
    """Return a number, vector or matrix of numpy as text with six digits."""
    if getattr(value, "ndim", 0):
        return f"[{', '.join(map(number, value))}]"
    return f"{value:.6g}"


def pieces(text: str) -> list[str]:
    """Split a text at its commas and return the parts; commas inside brackets do not split."""
    found, depth = [""], 0
    for character in text:
        depth += (character == "[") - (character == "]")
        if character == "," and depth == 0:
            found.append("")
        else:
            found[-1] += character
    return [piece.strip() for piece in found]


def columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table as text, every column as wide as its longest cell."""
    cells = list(rows)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
