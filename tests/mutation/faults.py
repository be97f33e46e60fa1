# SPDX-License-Identifier: BSD-2-Clause
"""Deliberate faults: every change of one token that could have been a slip of the pen in C code.

Operators are between spaces, because clang-format puts them there; a sign or a pointer does not.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple


class Fault(NamedTuple):
    """Characters `first` to `last` of a file, relative to fmus/, replaced by another text."""

    file: str
    kind: str
    first: int
    last: int
    text: str

    def applied(self, source: str) -> str:
        """The source with the fault."""
        return source[: self.first] + self.text + source[self.last :]

    def shown(self, source: str) -> str:
        """`flight/x.c:17 sign: a - b -> a + b`"""
        begin = source.rfind("\n", 0, self.first) + 1
        end = source.find("\n", self.last)
        line = source.count("\n", 0, self.first) + 1
        new = source[begin : self.first] + self.text + source[self.last : end]
        return f"{self.file}:{line} {self.kind}: {_flat(source[begin:end])} -> {_flat(new)}"


def _flat(text: str) -> str:
    return " ".join(text.split())


WORDS = {
    "add": ("sub",), "sub": ("add",), "sin": ("cos",), "cos": ("sin",), "fmin": ("fmax",),
    "fmax": ("fmin",), "mul": ("tmul",), "tmul": ("mul",), "floor": ("ceil",), "ceil": ("floor",),
    "matmul": ("matmul_t",), "matmul_t": ("matmul",), "dot": ("angle",),
}  # fmt: skip
OPERATORS = {
    "+": ("-",), "-": ("+",), "*": ("/",), "/": ("*",), "+=": ("-=", "="), "-=": ("+=", "="),
    "*=": ("/=",), "/=": ("*=",), "<": ("<=", ">"), ">": (">=", "<"), "<=": ("<", ">="),
    ">=": (">", "<="), "==": ("!=",), "!=": ("==",), "&&": ("||",), "||": ("&&",),
}  # fmt: skip
AXES = {"x": ("y", "z"), "y": ("z", "x"), "z": ("x", "y")}

_OPERATOR = re.compile(r"(?<=\s)([-+*/<>]|[-+*/<>=!]=|&&|\|\|)(?=\s)")
_SIGN = re.compile(r"(?<=[\s(,{\[])[-!](?=[\w(.])")
_NUMBER = re.compile(r"(?<![\w.])(\d+\.?\d*(?:[eE][-+]?\d+)?)(?![\w.])")
_AXIS = re.compile(r"(?<=[\w\])]\.)[xyz]\b")
_WORD = re.compile(r"\b[a-z_]\w*(?=\()")
_DIRECTIVE = re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.M)
_TEXT = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.S)


def masked(source: str) -> str:
    """The source with comments, texts and preprocessor lines as blanks, in their places."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", " ", match[0])

    return _DIRECTIVE.sub(blank, _TEXT.sub(blank, source))


def faults(file: str, source: str) -> Iterator[Fault]:
    """All faults of a source."""
    code = masked(source)
    for match in _OPERATOR.finditer(code):
        for text in OPERATORS[match[1]]:
            yield Fault(file, "operator", *match.span(), text)
        if match[1] in "+-" and (end := _end_of_term(code, match.end())):
            yield Fault(file, "dropped term", match.start(), end, "")
    for match in _SIGN.finditer(code):
        yield Fault(file, "sign", *match.span(), "")
    for match in _NUMBER.finditer(code):
        index = code[match.start() - 1] == "[" and code[match.end()] == "]"
        for text in _other_numbers(match[1]):
            yield Fault(file, "index" if index else "constant", *match.span(), text)
    for match in _AXIS.finditer(code):
        for text in AXES[match[0]]:
            yield Fault(file, "axis", *match.span(), text)
    for match in _WORD.finditer(code):
        for text in WORDS.get(match[0], ()):
            yield Fault(file, "function", *match.span(), text)
        if swapped := _swapped(source, code, match.end()):
            yield Fault(file, "swapped arguments", *swapped)


def _other_numbers(number: str) -> tuple[str, ...]:
    if number.isdigit():
        return (str(int(number) + 1), *([str(int(number) - 1)] if int(number) else []))
    value = float(number)
    return (repr(2 * value), repr(value / 2)) if value else ("1.0",)


def _pieces(code: str, first: int, ends: str) -> int | None:
    """Return the index of the first of these characters outside of all brackets."""
    depth = 0
    for k in range(first, len(code)):
        if depth == 0 and code[k] in ends:
            return k
        depth += (code[k] in "([{") - (code[k] in ")]}")
        if depth < 0:
            return None
    return None


def _end_of_term(code: str, first: int) -> int | None:
    """The end of the product that begins there."""
    end = _pieces(code, first, ",;)]}?:<>=&|")
    rest = code[first : end or first]
    for match in re.finditer(r"\s[-+](?=\s)", rest):
        if rest.count("(", 0, match.start()) == rest.count(")", 0, match.start()):
            return first + match.start()
    return end


def _swapped(source: str, code: str, opening: int) -> tuple[int, int, str] | None:
    """The first two arguments of a call in the other order."""
    comma = _pieces(code, opening + 1, ",")
    end = comma and _pieces(code, comma + 1, ",)")
    if not comma or not end:
        return None
    a, b = source[opening + 1 : comma].strip(), source[comma + 1 : end].strip()
    return None if a == b else (opening + 1, end, f"{b}, {a}")


def c_files(root: Path) -> list[str]:
    """The sources and headers below a folder, except in the build."""
    files = sorted(p for ending in "ch" for p in root.rglob(f"*.{ending}"))
    names = [p.relative_to(root) for p in files]
    return [name.as_posix() for name in names if "build" not in name.parts]


def python_files(root: Path, packages: Sequence[str]) -> list[str]:
    """The modules in some folders of a folder."""
    found = (p.relative_to(root).as_posix() for r in packages for p in (root / r).rglob("*.py"))
    return sorted(found)


def drawn(
    root: Path,
    files: Sequence[str],
    find: Callable[[str, str], Iterable[Fault]],
    seed: int,
    count: int,
) -> list[Fault]:
    """So many different faults in files below a folder, each as likely as any other.

    find: gives all faults of a file from its name and its text.
    """
    every = [f for name in files for f in find(name, (root / name).read_text(encoding="utf-8"))]
    return random.Random(seed).sample(every, min(count, len(every)))
