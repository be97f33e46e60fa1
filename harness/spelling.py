# SPDX-License-Identifier: BSD-2-Clause
"""Close matches of misspelt names, for the end of an error message."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Close matches of a misspelt or shortened name as the end of a line, e.g. " (close: J_T,
    J_S)", or nothing.
    """
    names = list(known)
    close = (
        difflib.get_close_matches(name, names, n=3)
        or [each for each in names if name in each and len(name) > 2][:3]
    )
    return f" (close: {', '.join(close)})" if close else ""
