# SPDX-License-Identifier: BSD-2-Clause
"""FMPy as a validator of many FMUs: what it reads anew for every one of them is read once."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from fmpy.validation import validate_fmu
from lark import Lark
from lxml import etree

schema = cache(etree.XMLSchema)


@cache
def grammar(text, **options):
    """The grammar of names, and what has been found a name once; to it one number is like another,
    so that all elements of an array have one name.
    """
    made = Lark(text, **options)
    parse = cache(made.parse)
    made.parse = lambda name: parse(re.sub(r"\d+", "1", name))
    return made


def problems(path: Path) -> list[str]:
    """Return the problems that FMPy finds in an FMU."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(etree, "XMLSchema", schema)
        patch.setattr("lark.Lark", grammar)
        return validate_fmu(str(path))
