# SPDX-License-Identifier: BSD-2-Clause
"""Draw the share of runs with a capture over the tumble rate of the target, with the rates that
limit a capture.

python .ci/capture_picture.py results/servicing_mission_dispersions.zarr PICTURE.png
"""

from __future__ import annotations

import sys
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr

from harness import run
from harness.studies.campaign.summary import wilson

SYSTEM = "servicing_mission_navigated"
NOMINAL = float(np.hypot(0.002, 0.01))
"""Nominal tumble rate of the target [rad/s]."""


def shares(data: Any) -> list[tuple[float, int, int]]:
    """Return a row per tumble rate: rate [rad/s], number of captures, number of complete runs."""
    rate = np.linalg.norm(data["target.omega_TN_T_0"].values, axis=1).round(6)
    complete, captured = data["status"].values == 1, data["captured"].values == 1
    return [
        (
            float(w),
            int((captured & complete & (rate == w)).sum()),
            int((complete & (rate == w)).sum()),
        )
        for w in np.unique(rate)
    ]


def limits() -> dict[str, float]:
    """Return the largest tumble rates [rad/s] that the servicer can follow, by their texts in the
    legend of the picture: two that its wheels limit, then two that its force limits.

    Wheels: J rate = share * largest momentum of a wheel, where J is the inertia of the servicer and
    the share is 1, or bias_max + budget if the wheel has a bias before the servicer turns.

    "all force": turning with the target at the least range of the fly-around, R_around, needs the
    full force F_axis. "force within the budget: retreat": turning at this rate plus steer_least,
    the rate left for steering about the target, needs the share `budget` of F_axis, which the
    mission manager permits; above this rate the manager orders a retreat.
    """
    result = run(SYSTEM, stop=0.1)
    names: tuple[str, ...] = ("budget", "F_axis", "R_around", "steer_least", "J_S", "A_w")
    names += ("wheel_speed_max", "bias_max")
    p = {name: np.array(result.parameter(f"manager.{name}"), float) for name in names}
    mass = float(result.parameter("servicer.mass_0"))
    wheel, J = p["A_w"][1, 1] * p["wheel_speed_max"], p["J_S"][1, 1]
    force = p["F_axis"] / (mass * p["R_around"])
    most = (p["bias_max"] + p["budget"]) * wheel
    return {
        "a wheel without bias": float(wheel / J),
        "a wheel with bias; above it, thrusters help": float(most / J),
        "force within the budget: retreat": float(np.sqrt(p["budget"] * force) - p["steer_least"]),
        "all force": float(np.sqrt(force)),
    }


def main(dataset: str, picture: str) -> None:
    """Draw the picture; dataset: path of the .zarr with the runs; picture: path to write."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    found = [row for row in shares(xr.open_zarr(dataset, consolidated=False)) if row[2]]
    figure, axes = plt.subplots(figsize=(7, 3.6), dpi=80, layout="constrained")
    for w, captured, count in found:
        low, high = wilson(captured, count)
        axes.plot([w / NOMINAL] * 2, [low, high], color="C0")
        axes.plot(w / NOMINAL, captured / count, "o", color="C0")
        axes.annotate(f"{captured}/{count}", (w / NOMINAL, low), (0, -12), ha="center",
                      textcoords="offset points", fontsize=8)  # fmt: skip
    for k, (name, w) in enumerate(limits().items()):
        axes.axvline(w / NOMINAL, color=f"C{k + 1}", linestyle="--", label=name)
    axes.set(xlim=(0, 4.2), ylim=(0, 1.05), xlabel=f"tumble rate / {NOMINAL:.4f} rad/s",
             ylabel="share captured, 95 % interval")  # fmt: skip
    axes.legend(loc="lower left", fontsize=8)
    figure.savefig(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
