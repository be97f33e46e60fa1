"""`python -m harness.validation [CASE ...] [--write docs/validation.md]`: fly the cases, print the
table, write the page. Exit status 1 if one differs.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from harness.validation import markdown, table, validate


def main() -> int:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(prog="python -m harness.validation", description=__doc__)
    parser.add_argument("cases", nargs="*", help="names of cases; all if there is none")
    parser.add_argument("--write", type=Path, help="write the page to this Markdown file")
    options = parser.parse_args()
    rows = validate(options.cases or None)
    print(table(rows))
    if options.write:
        options.write.write_text(markdown(rows), encoding="utf-8")
    return 0 if all(row.within for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
