# SPDX-License-Identifier: BSD-2-Clause
"""Check flight software against the guidelines of MISRA C:2012 with the addon of cppcheck.

    python .ci/misra.py                                                              (make misra)

Prints the number of violations per rule. Exits with 1 if cppcheck finds a violation of a rule that
.ci/misra.toml does not list, or none of a rule that .ci/misra.toml lists: an obsolete deviation
must be removed.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from fmus.core.build import flight_rules

LIST = Path(__file__).with_name("misra.toml")
FOUND = re.compile(r"^(\S+):(\d+): misra-c2012-([\d.]+)$", re.MULTILINE)


def deviations() -> dict[str, str]:
    """Return the reasons of the deviations in .ci/misra.toml by rule."""
    return tomllib.loads(LIST.read_text(encoding="utf-8"))["deviations"]


def places(sources: Iterable[Path]) -> dict[str, set[tuple[str, int]]]:
    """Return, by rule, the file names and lines where the rule is violated. Each source is checked
    alone, with the headers that it includes.
    """
    found: dict[str, set[tuple[str, int]]] = {}
    for source in sources:
        for file, line, rule in FOUND.findall(report(source)):
            found.setdefault(rule, set()).add((Path(file).name, int(line)))
    return found


def report(source: Path) -> str:
    """Return the output of cppcheck for a C file: FILE:LINE: misra-c2012-RULE per violation."""
    options = ["--addon=misra", "--quiet", "--std=c99", "--platform=unix64"]
    options += ["--suppress=missingIncludeSystem", "--template={file}:{line}: {id}"]
    with tempfile.TemporaryDirectory() as folder:
        command = ["cppcheck", *options, f"--cppcheck-build-dir={folder}", *flight_rules.INCLUDE]
        done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=True)
    return done.stderr


def differences(found: Mapping[str, Iterable], known: Mapping[str, str]) -> Iterator[str]:
    """Yield a message per rule that is violated but not listed, or listed but not violated."""
    for rule in sorted(found.keys() - known.keys(), key=order):
        shown = ", ".join(f"{file}:{line}" for file, line in sorted(found[rule])[:5])
        yield f"rule {rule}: {shown}: change the code, or state a deviation in .ci/misra.toml\n"
    for rule in sorted(known.keys() - found.keys(), key=order):
        yield f"rule {rule}: found nowhere; remove its deviation from .ci/misra.toml\n"


def order(rule: str) -> tuple[int, ...]:
    """Return the sort key of a rule: (8, 13) for 8.13."""
    return tuple(map(int, rule.split(".")))


def main() -> None:
    """Run the command line, see the docstring of the module."""
    found, known = places(flight_rules.sources()), deviations()
    for rule in sorted(found, key=order):
        print(f"{rule}: {len(found[rule])} places: {known.get(rule, '?')}")
    sys.exit("".join(differences(found, known)) or 0)


if __name__ == "__main__":
    main()
