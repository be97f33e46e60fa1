# SPDX-License-Identifier: BSD-2-Clause
"""The FMUs call no function of a C library whose last bits depend on the library."""

import re
import sys
from pathlib import Path

import pytest

from tests.each import each

SOURCES = Path(__file__).parents[2] / "fmus"
ALLOWED = re.compile(r"(calloc|free|malloc|mem(cmp|cpy|move|set)|snprintf|str(cmp|len)|_\w*)\b")
"""Memory, texts and messages: no numbers. What begins with _ belongs to the compiler."""
COMMENTS_AND_TEXTS = re.compile(r'/\*.*?\*/|//.*?$|"(?:\\.|[^"\\\n])*"', re.DOTALL | re.MULTILINE)
CALLS = re.compile(
    r"""(?<![\w.>])(
        a?(sin|cos|tan)h? | atan2 | sincos | exp(2|10|m1)? | log(2|10|1p|b)? | ilogb | pow | cbrt
        | hypot | fma | fmod | remainder | remquo | modf | frexp | ldexp | scalbl?n | ceil | floor
        | trunc | l?l?round | l?l?rint | nearbyint | fmin | fmax | fdim | nextafter | erfc?
        | [tl]gamma
    )[fl]?(?=\s*\()""",
    re.VERBOSE,
)
"""Functions of math.h but for those that compilers replace by exact instructions: sqrt, fabs,
copysign and the classifications.
"""


def calls_of_maths(text):
    return [found[0] for found in CALLS.finditer(COMMENTS_AND_TEXTS.sub(" ", text))]


@each("source", sorted(SOURCES.rglob("*.[ch]")))
def test_sources_call_the_functions_of_portable_math(source):
    assert not calls_of_maths(source.read_text()), "portable_math.h and exact.h have them"


def test_calls_are_found_and_names_that_only_look_alike_are_not():
    text = 'y = sin (x) + a.exp(2) + sine(x); /* cos(x) */ printf("log(x)"); z = fmaxf(1, 2);'
    assert calls_of_maths(text) == ["sin", "fmaxf"]


@pytest.mark.skipif(sys.platform != "linux", reason="nm for ELF files")
def test_binaries_import_no_mathematics(symbols):
    imports = {name for name, letter in symbols.items() if letter in "Uw"}
    assert imports
    assert [name for name in imports if not ALLOWED.fullmatch(name)] == []
