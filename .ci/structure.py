# SPDX-License-Identifier: BSD-2-Clause
"""Structural coverage of C files: statements, branches and conditions that tests reach, from the
counters of clang (-fcoverage-mcdc), and the checked list of those that they do not reach.

Several libraries may contain a file; a part of the file is reached if the tests reach it in any of
them. A condition of a decision with several conditions is shown (MC/DC) if two evaluations differ
in the value of this condition alone and in the outcome of the decision.
"""

import json
import subprocess
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

REASONS = Path(__file__).with_name("unreached.toml")
CODE = 0
"""Value of the kind of a region, in the output of llvm-cov, that means code; other values mean,
for example, a macro or a skipped part.
"""

Span = tuple[int, int, int, int]
"""First line and column, last line and column."""


class Counters(NamedTuple):
    """Counters of a file: runs of each statement, outcomes true and false of each condition, and
    for each decision whether each of its conditions is shown (MC/DC).
    """

    statements: dict[Span, int]
    branches: dict[Span, tuple[int, int]]
    decisions: dict[Span, tuple[bool, ...]]

    def reached(self) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
        """Return three pairs (number reached, number in all): statements, branches, conditions."""
        statements = [n > 0 for n in self.statements.values()]
        branches = [n > 0 for pair in self.branches.values() for n in pair]
        conditions = [shown for decision in self.decisions.values() for shown in decision]
        return tuple((sum(x), len(x)) for x in (statements, branches, conditions))


class Missing(NamedTuple):
    """Line of a file with parts that tests do not reach; line: its code; what: description of each
    part.
    """

    file: str
    line: str
    what: tuple[str, ...]


def exported(library: Path, profile: Path) -> Mapping:
    """Return the counters of a library as `llvm-cov export` prints them; {} if the profile has none
    for this library.
    """
    command = ["llvm-cov-19", "export", "-instr-profile", profile, library]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return json.loads(done.stdout)["data"][0] if done.stdout else {}


def counters(exports: Iterable[Mapping], root: Path) -> dict[str, Counters]:
    """Return the counters of all files below `root` by path relative to it, combined over the
    libraries; exports: counters of each library from exported().
    """
    found: dict[str, Counters] = {}

    def of(name: str) -> Counters | None:
        path = Path(name)
        if not path.is_relative_to(root):
            return None
        return found.setdefault(str(path.relative_to(root)), Counters({}, {}, {}))

    for export in exports:
        for function in export.get("functions", ()):
            names = function["filenames"]
            for *span, count, file, _, kind in function["regions"]:
                if (c := of(names[file])) and kind == CODE and span[:2] != span[2:]:
                    add_statement(c, tuple(span), count)
        for file in export.get("files", ()):
            if c := of(file["filename"]):
                add_decisions(c, file)
    return found


def add_statement(c: Counters, span: Span, count: int) -> None:
    """Add `count` runs of a statement to the counters of its file."""
    c.statements[span] = c.statements.get(span, 0) + count


def add_decisions(c: Counters, file: Mapping) -> None:
    """Add the branches and decisions of a file, exported from one library, to its counters."""
    for *span, true, false, _, _, _ in file["branches"]:
        before = c.branches.get(tuple(span), (0, 0))
        c.branches[tuple(span)] = (before[0] + true, before[1] + false)
    for *span, _, _, shown in file["mcdc_records"]:
        before = c.decisions.get(tuple(span), (False,) * len(shown))
        c.decisions[tuple(span)] = tuple(map(max, before, shown))


# ---- what is not reached ----
def text_of(lines: Sequence[str], span: Span) -> str:
    """Return the code of a span, joined to one line."""
    first, column, last, end = span
    part = list(lines[first - 1 : last])
    part[-1] = part[-1][: end - 1]
    part[0] = part[0][column - 1 :]
    return " ".join(" ".join(part).split())


def unreached(c: Counters, lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield line number and description of every statement, branch and condition that tests do not
    reach; lines: the source.
    """
    for span, count in sorted(c.statements.items()):
        if not count:
            yield span[0], f"not run: {text_of(lines, span)}"
    for span, outcomes in sorted(c.branches.items()):
        for outcome, count in zip(("true", "false"), outcomes, strict=True):
            if not count:
                yield span[0], f"never {outcome}: {text_of(lines, span)}"
    for span, shown in sorted(c.decisions.items()):
        for number, good in enumerate(shown, 1):
            if not good:
                yield span[0], f"not shown: condition {number} of {text_of(lines, span)}"


def missing(name: str, c: Counters, lines: Sequence[str]) -> Iterator[Missing]:
    """Yield a Missing per line with a part that tests do not reach; name: path of the file."""
    by_line: dict[int, dict[str, None]] = {}
    for number, text in unreached(c, lines):
        by_line.setdefault(number, {})[text] = None
    for number, texts in sorted(by_line.items()):
        yield Missing(name, lines[number - 1].strip(), tuple(texts))


# ---- reasons ----
def reasons(file: Path = REASONS) -> dict[Missing, str]:
    """Return the reasons that .ci/unreached.toml states for parts that tests do not reach."""
    entries = tomllib.loads(file.read_text(encoding="utf-8")).get("unreached", ())
    return {Missing(e["file"], e["line"], tuple(e["missing"])): e["reason"] for e in entries}


def differences(found: Iterable[Missing], known: Mapping[Missing, str]) -> Iterator[str]:
    """Yield a message per line that is not reached and has no reason, and per entry of
    .ci/unreached.toml whose line or parts differ from what the tests do not reach.
    """
    there = set(found)
    for m in sorted(there - set(known)):
        yield (
            f"{m.file}: tests do not reach {m.line}: add a test, or a reason to "
            ".ci/unreached.toml\n"
        ) + "".join(f"    {what}\n" for what in m.what)
    for m in sorted(set(known) - there):
        yield (
            f"{m.file}: .ci/unreached.toml does not match what the tests reach: "
            f"correct its entry {m.line}\n"
        )
