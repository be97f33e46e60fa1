# SPDX-License-Identifier: BSD-2-Clause
"""Optima of runs that have been computed: `harness bound` on the cases of .ci/bounds.py."""

from __future__ import annotations

import json
import math
from functools import cache
from hashlib import sha256
from pathlib import Path

from harness.mission import Limits, Metric
from harness.results.result import Result

FILE = Path(__file__).with_name("optima.json")


def case(result: Result) -> str:
    """Return a hash of what the optimum depends on: system, stop time, and all parameters but of
    the controller.
    """
    if result.parameters is None:
        return ""
    values = zip(result.parameters.columns, result.parameters.values[0].tolist(), strict=True)
    given = sorted(f"{name}={x!r}" for name, x in values if not name.startswith("controller."))
    text = "\n".join([result.system, f"{result.time[-1]:.9g}", *given])
    return sha256(text.encode()).hexdigest()[:16]


@cache
def stored() -> dict[str, float]:
    """Return the least impulses [N s] by case."""
    found: dict[str, float] = json.loads(FILE.read_text(encoding="utf-8"))
    return found


def _of_the_optimum(result: Result, _: Limits) -> float:
    spent = float(result["propulsion.impulse"][-1].sum())
    return spent / stored().get(case(result), math.nan)


METRIC = Metric("x optimum", "1", ("propulsion.impulse",), _of_the_optimum)
"""Impulse over the least impulse of the case, where that is stored."""
