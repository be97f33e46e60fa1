# SPDX-License-Identifier: BSD-2-Clause
"""Close matches of misspelt names, for the end of an error message, and names made fit to be shown
and to be files.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
    names = _comparable(tuple(known))
    close = (
        difflib.get_close_matches(name, names.like(name), n=3)
        or [each for each in names.names if name in each and len(name) > 2][:3]
    )
    return f" (close: {', '.join(close)})" if close else ""


@lru_cache(maxsize=8)
def _comparable(known: tuple[str, ...]) -> _Names:
    return _Names(tuple(each for each in dict.fromkeys(known) if len(each) <= LONGEST))


class _Names:
    """Names by their pairs of letters, for many misspelt ones that are compared with them."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names

    @cached_property
    def _with(self) -> dict[str, NDArray[np.intp]]:
        """Numbers of the names that have a pair of letters."""
        import numpy as np

        found: dict[str, list[int]] = {}
        for number, each in enumerate(self.names):
            for pair in _pairs(each):
                found.setdefault(pair, []).append(number)
        return {pair: np.array(numbers) for pair, numbers in found.items()}

    @cached_property
    def _lengths(self) -> NDArray[np.intp]:
        import numpy as np

        return np.array([len(each) for each in self.names])

    def like(self, name: str) -> Sequence[str]:
        """The names that share most pairs of letters with one, relative to their lengths; of
        equals the first.
        """
        import numpy as np

        if len(self.names) <= CANDIDATES:
            return self.names
        shared = np.zeros(len(self.names))
        for pair in _pairs(name):
            if pair in self._with:
                shared[self._with[pair]] += 1
        score = shared / (self._lengths + len(name))
        least = np.partition(score, -CANDIDATES)[-CANDIDATES]
        better = np.flatnonzero(score > least)
        equal = np.flatnonzero(score == least)[: CANDIDATES - len(better)]
        return [self.names[number] for number in np.sort(np.append(better, equal))]


def _pairs(name: str) -> frozenset[str]:
    """Pairs of neighbouring letters, the margins included."""
    framed = f"^{name}$"
    return frozenset(map("".join, pairwise(framed)))


SHOWN = 5
"""Things that a line names."""


def some(things: Sequence[object]) -> str:
    """The first of several things, and how many more there are."""
    more = f" and {len(things) - SHOWN} more" if len(things) > SHOWN else ""
    return f"{', '.join(map(str, things[:SHOWN]))}{more}"


def printable(text: str) -> str:
    """A text without characters that control a terminal or turn the direction of writing; line
    breaks and tabs stay.
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(map(_harmless, text))


def one_line(text: str) -> str:
    """The same for a cell of a table: without line breaks and tabs too."""
    return printable(text).replace("\n", "\\n").replace("\t", "\\t")


def _harmless(character: str) -> str:
    """The character, or its code if it controls something."""
    is_control = unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    if character in "\n\t" or not is_control:
        return character
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def file_stem(name: str) -> str:
    """A name as that of a file in the folder at hand: no path, nothing hidden, nothing odd."""
    return re.sub(r"[^\w.-]+", "_", name).lstrip(".-")[:100] or "system"


def is_number(text: str) -> bool:
    """Whether a text reads as a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def columns(rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a table as text, every column as wide as its longest cell."""
    cells = list(rows)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]
