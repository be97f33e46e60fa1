# SPDX-License-Identifier: BSD-2-Clause
"""Numbers by others: published cases flown through the FMUs, and how far our answer is from theirs.

What enters is data alone (cases/*.json: parameters, expected rows, tolerance, source and licence
beside each number, models that are wrong on purpose). What leaves is one row per case and quantity.
A room of its own because nothing here may be computed by what it judges.

    from harness.validation import table, validate
    print(table(validate(["vallado-2-4"])))
"""

from __future__ import annotations

from harness.validation.case import Case, cases
from harness.validation.judge import Row, judge
from harness.validation.table import markdown, table, validate

__all__ = ["Case", "Row", "cases", "judge", "markdown", "table", "validate"]
