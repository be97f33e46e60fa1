# SPDX-License-Identifier: BSD-2-Clause
"""Run all cases of `harness validate` and write the page docs/validation.md from them; the exit
status is 1 if a case does not agree.

python .ci/validation.py docs/validation.md      # make validation
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from harness.claims.case import agreement, table, validate
from harness.mission.claim import Row

HEAD = """# Validation

Published reference values, and the differences of the FMUs from them. `make validation` writes this
page from its run. A difference is the largest over the rows of a case: the Euclidean norm of the
difference of two vectors, the rotation angle between two attitude matrices `C`, or the amount by
which a published limit is violated. Repeat a case with `harness validate CASE`.

`ssp/validation/cases/` holds the data, the reasons for the tolerances, and wrong models that must
exceed them. `tests/external/` runs all cases, `basilisk-wheels` only in `make test-long`. The
documentation site (`make site`) has a page per source with the differences over time.

"""


def markdown(rows: Sequence[Row]) -> str:
    """Return the page docs/validation.md; rows: results of all cases."""
    lines = ["| case | what it tests | made by | differences (tolerances) |", "|---|---|---|---|"]
    for name, group in groupby(rows, key=lambda row: row.case):
        of = list(group)
        found = "; ".join(
            f"`{r.quantity}` {r.difference:.1g} ({r.tolerance:.1g}) {r.unit}" for r in of
        )
        made = f"{of[0].source['name']}; {of[0].source['licence']}"
        lines.append(f"| `{name}` | {of[0].tests} | {made} | {found} |")
    return f"{HEAD}{agreement(rows)}.\n\n" + "\n".join(lines) + "\n"


def main(page: Path) -> int:
    """Run the cases and write the page; return the exit status."""
    rows = validate()
    print(table(rows))
    page.write_text(markdown(rows), encoding="utf-8")
    return 0 if all(row.within for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
