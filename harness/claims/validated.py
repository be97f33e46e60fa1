# SPDX-License-Identifier: BSD-2-Clause
"""Numbers by others beside ours: all cases of the missions at hand, as text and as a page."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from harness.errors import UsageError
from harness.mission.claim import Row
from harness.mission.library import everything
from harness.spelling import did_you_mean

HEAD = """# Validation

Numbers computed and published by others, and how far the FMUs are from them. `make validation`
writes this page from its run. A difference is the largest over the rows of a case: the Euclidean
norm of a vector, the angle of the attitude matrix `C`. Repeat a case with `harness validate
CASE`. The data, the reasons for the tolerances, and wrong models that must miss them:
`ssp/validation/cases/`; `tests/external/` runs all of them in `make test`. The documentation site
(`make site`) has a page per source with the differences over time.

"""


def validate(names: Sequence[str] | None = None) -> list[Row]:
    """One row per quantity of the cases of that name, or of all; UsageError for an unknown name."""
    offered = everything().validations
    known = {name: each for each in offered for name in each.names()}
    for name in names or ():
        if name not in known:
            raise UsageError(f"{name}: there is no such case{did_you_mean(name, known)}")
    wanted = list(known) if names is None else names
    return [row for each in offered for row in each.answer([n for n in wanted if known[n] is each])]


def table(rows: Sequence[Row]) -> str:
    """Plain text, one line per quantity, and how many cases agree."""
    lines = [f"{'case':34}{'quantity':14}{'difference':>11}{'tolerance':>11}  {'unit':8}verdict"]
    for row in rows:
        verdict = "agrees" if row.within else "DIFFERS"
        lines.append(
            f"{row.case:34}{row.quantity:14}{row.difference:11.2g}{row.tolerance:11.2g}"
            f"  {row.unit:8}{verdict}"
        )
    verdicts = {name: all(row.within for row in of) for name, of in _by_case(rows)}
    return "\n".join([*lines, "", f"{sum(verdicts.values())} of {len(verdicts)} cases agree"])


def markdown(rows: Sequence[Row]) -> str:
    """The page docs/validation.md."""
    lines = ["| case | what it tests | made by | differences (tolerances) |", "|---|---|---|---|"]
    for name, of in _by_case(rows):
        case = of[0]
        found = "; ".join(
            f"`{r.quantity}` {r.difference:.1g} ({r.tolerance:.1g}) {r.unit}" for r in of
        )
        made = f"{case.source['name']}; {case.source['licence']}"
        lines.append(f"| `{name}` | {case.tests} | {made} | {found} |")
    agree = sum(all(row.within for row in of) for _, of in _by_case(rows))
    total = len(_by_case(rows))
    return HEAD + f"{agree} of {total} cases agree.\n\n" + "\n".join(lines) + "\n"


def _by_case(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    return [(name, list(of)) for name, of in groupby(rows, key=lambda row: row.case)]
