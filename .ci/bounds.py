# SPDX-License-Identifier: BSD-2-Clause
"""Compute the least impulses of the runs in docs/how_good.md, print the tables of that page, and
write the optima to ssp/shared/optima.json. `harness compare` divides the impulse of a run by
the optimum in this file (metric `x optimum`).

    python .ci/bounds.py                                          # 6 minutes
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from harness import run  # noqa: E402
from harness.studies.show import bound  # noqa: E402
from ssp.shared import optima  # noqa: E402
from ssp.shared.convex import solve  # noqa: E402
from ssp.shared.least_impulse import Answer  # noqa: E402
from ssp.shared.phase_impulses import phase_optimum  # noqa: E402
from tests.reference import optimal_start  # noqa: E402

LAWS = (
    *(("sync_approach", "limited", f"{name}_controller")
      for name in ("adaptive", "theta_d", "ppc", "optimal")),
    *(("ppc_tracking", "limited", f"{name}_controller") for name in ("ppc", "pid", "theta_d")),
    *(("relay_approach", params, "relay_controller") for params in ("limited", "geo")),
    ("arch_rendezvous", "default", "switched_controller"),
)  # fmt: skip
"""Triples (system, parameter set, controller); of each system and parameter set the default
controller comes first.
"""
CONSTRAINTS = {
    "sync_approach": ("corridor", "distance", "tracking", "pointing"),
    "ppc_tracking": ("range", "distance", "closing"),
}
ITERATIONS = (9, 20, 50, 60)


def laws(cases: dict[str, list[optima.Leg]]) -> None:
    """Print a row per entry of LAWS: impulse, optimum and ratio for the sum of the absolute force
    components as cost; optimum and ratio for the norm of the force as cost; distance between the
    end of the optimal path and the end of a simulation with the optimal force. Store the optimum of
    the first controller of each system and parameter set in `cases`, by the key that
    optima.case() returns for the run.
    """
    print(
        "| case | controller | impulse | optimum [N s] | ratio | optimum of the norm | ratio | "
        "open loop off the plan [mm] |"
    )
    for system, params, law in LAWS:
        found = {cost: _bound(system, params, law, cost) for cost in ("sum", "norm")}
        cells = [x for a in found.values() for x in (a.spent, a.optimum.impulse)]
        cases.setdefault(optima.case(found["sum"].run), [optima.leg(found["sum"].optimum)])
        print(f"| {system} {params} | {law} | {cells[0]:.1f} | {cells[1]:.1f} | "
              f"{cells[0] / cells[1]:.2f} | {cells[3]:.1f} | {cells[2] / cells[3]:.2f} | "
              f"{1e3 * found['sum'].miss:.0f} |", flush=True)  # fmt: skip


def _bound(system: str, params: str, law: str, cost: str) -> Answer:
    return bound(system, cost=cost, params=params, swap={"controller": law})


def phases(cases: dict[str, list[optima.Leg]]) -> None:
    """Print, for three parameter sets of the servicing mission, the velocity increments of its
    phases beside their optima, then the optimum of each phase without one of its constraints, one
    row per constraint [m/s]. Store the optima of the phases in `cases`, by the key that
    optima.case() returns for the run.
    """
    for params in (None, "optimal", "limited"):
        found = bound("servicing_mission", params=params)
        cases[optima.case(found.run)] = [optima.leg(p.optimum) for p in found.phases.values()]
        print(f"set {params or 'default'}", *found.lines(), sep="\n", flush=True)
        for name, phase in found.offered.phases(found.run, None).items():
            for cone in phase.problem.cones:
                best = phase_optimum(phase, without=(cone.name,)).impulse / phase.problem.mass
                print(f"| {name} | {cone.name} | {best:.3f} |", flush=True)


def prices() -> None:
    """Print the least impulses [N s] of the systems in CONSTRAINTS: with all constraints, without
    each single one, with the first one only, and with none.
    """
    for system, names in CONSTRAINTS.items():
        for without in ((), *((name,) for name in names), names[1:], names):
            best = bound(system, params="limited", without=without).optimum.impulse
            print(f"| {system} | {', '.join(without) or 'none'} | {best:.1f} |", flush=True)


def iterations() -> None:
    """Print, for several numbers of iterations of the optimal controller, the impulse [N s], the
    least corridor margin, the least range [m] and the largest bound of the violation of position
    constraints by the path that the controller plans [m].
    """
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
    """Print the impulse [N s] and the largest violation of the corridor [m] of the first plan of
    the synchronised approach: a row per number of iterations of the optimal controller, which
    begins without an earlier plan, and a row for the optimum.
    """
    for count in (5, 10, 20, 50, 200, 5000):
        print("| {} | {:.1f} | {:.3f} |".format(count, *optimal_start.iterated(count)))
    print(f"| optimum | {solve(optimal_start.problem()).impulse:.1f} | 0 |")


def main() -> None:
    """Print the tables and write the file of optima."""
    cases: dict[str, list[optima.Leg]] = {}
    laws(cases)
    phases(cases)
    optima.write(optima.FILE, cases)
    prices()
    iterations()
    cold()


if __name__ == "__main__":
    main()
