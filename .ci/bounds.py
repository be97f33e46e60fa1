# SPDX-License-Identifier: BSD-2-Clause
"""Least impulses of cases: the file for the column `x optimum` of comparisons, and the tables of
docs/how_good.md.

    python .ci/bounds.py                                          # 6 minutes
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from harness import run  # noqa: E402
from harness.studies.optimum import Answer, bound, solve  # noqa: E402
from ssp.shared import optima  # noqa: E402
from tests.reference import optimal_start  # noqa: E402

LAWS = {
    "sync_approach": ("adaptive_controller", "theta_d_controller", "ppc_controller",
                      "optimal_controller"),
    "ppc_tracking": ("ppc_controller", "pid_controller", "theta_d_controller"),
    "relay_approach": ("relay_controller",),
}  # fmt: skip
CONSTRAINTS = ("corridor", "distance", "tracking", "pointing")
ITERATIONS = (9, 20, 50, 60)


def laws(cases: dict[str, float]) -> None:
    """Print a row per law and store the optimum of the law that a system has by default."""
    print("| case | law | impulse | optimum [N s] | ratio | norm | ratio | off plan [mm] |")
    for system, names in LAWS.items():
        for name in names:
            found = {cost: _bound(system, name, cost) for cost in ("sum", "norm")}
            cells = [x for a in found.values() for x in (a.spent, a.optimum.impulse)]
            cases.setdefault(optima.case(found["sum"].run), round(cells[1], 6))
            print(f"| {system} | {name} | {cells[0]:.1f} | {cells[1]:.1f} | "
                  f"{cells[0] / cells[1]:.2f} | {cells[3]:.1f} | {cells[2] / cells[3]:.2f} | "
                  f"{1e3 * found['sum'].miss:.0f} |", flush=True)  # fmt: skip


def _bound(system: str, law: str, cost: str) -> Answer:
    return bound(system, cost=cost, params="limited", swap={"controller": law})


def phases() -> None:
    """Print the increments of the phases of a mission beside their optima [m/s]."""
    for params in (None, "optimal"):
        print(*bound("servicing_mission", params=params).lines(), sep="\n", flush=True)


def prices() -> None:
    """Print the optimum of the synchronised approach without single constraints."""
    sets = ((), *((name,) for name in CONSTRAINTS), CONSTRAINTS[1:], CONSTRAINTS)
    for without in sets:
        best = bound("sync_approach", params="limited", without=without).optimum.impulse
        print(f"| {', '.join(without) or 'none'} | {best:.1f} |", flush=True)


def iterations() -> None:
    """Print what the optimal controller needs with other numbers of iterations."""
    for count in ITERATIONS:
        changes = {"controller.iterations": count, "controller.iterations_first": count}
        found = run("sync_approach", params="limited", swap={"controller": "optimal_controller"},
                    set=changes)  # fmt: skip
        spent = found["propulsion.impulse"][-1].sum()
        margin = found["monitor.corridor_margin"].min()
        residual = found["controller.residual_p"].max()
        least = found["guidance.range"].min()
        print(
            f"| {count} | {spent:.1f} | {margin:.3f} | {least:.3f} | {residual:.3f} |", flush=True
        )


def cold() -> None:
    """Print what iterations from a cold start give for the start of the synchronised approach."""
    for count in (5, 10, 20, 50, 200, 5000):
        print("| {} | {:.1f} | {:.3f} |".format(count, *optimal_start.iterated(count)))
    print(f"| optimum | {solve(optimal_start.problem()).impulse:.1f} | 0 |")


def main() -> None:
    """Print the tables and write the file."""
    cases: dict[str, float] = {}
    laws(cases)
    phases()
    prices()
    iterations()
    cold()
    optima.FILE.write_text(json.dumps(cases, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
