# SPDX-License-Identifier: BSD-2-Clause
"""The rendezvous benchmark SPRE as the system arch_rendezvous flies it.

Units of the benchmark: m, min, kg; a gain is kg/min2 on positions and kg/min on velocities. The
instances differ in the time of the abort, anywhere in an interval; starts fill a box.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from harness.validation.library import Library, fly_system

if TYPE_CHECKING:
    from harness.validation.case import Case

Array = NDArray[np.float64]
SYSTEM = "arch_rendezvous"
MINUTE = 60.0
EVERY, INTERVAL = 1500, 300.0
"""Macro steps between two recorded rows, and their distance [s]."""
HALF_ANGLE = np.radians(30)
SPEED_LIMIT, BOX = 3.3, 0.2
"""m/min during the attempt; half the side of the target [m]."""
START = ((-925.0, -875.0), (-425.0, -375.0))
"""x and y of the start box, Hill axes [m]."""
NEVER = 1e9


@dataclass(frozen=True)
class Instance:
    """An instance of the benchmark: abort interval [min] and the published verdict."""

    name: str
    abort: tuple[float, float]
    safe: bool = True


INSTANCES = (
    Instance("SRNA01", (NEVER / MINUTE, NEVER / MINUTE)),
    Instance("SRA01", (120, 120)),
    Instance("SRA02", (120, 125)),
    Instance("SRA03", (120, 145)),
    Instance("SRA04", (240, 240)),
    Instance("SRA05", (235, 240)),
    Instance("SRA06", (230, 240)),
    Instance("SRA07", (50, 150)),
    Instance("SRA08", (0, 240)),
    Instance("SRU01", (260, 260), safe=False),
    Instance("SRU02", (0, 260), safe=False),
)


# ---- one flight


def rendezvous(case: Case, library: Library) -> list[dict[str, Array]]:
    """Positions [m] and velocities [m/min] in the Hill frame at the rows; los, speed and box: the
    least of -x tan 30 deg - |y|, the highest speed, and the least max(|x|, |y|) in their phases.
    """
    del library  # a whole system, loaded by the master
    stop = case.rows[-1]["t"]
    result = fly_system(SYSTEM, stop=stop, every=EVERY, set=_changes(case))
    keep_out, corridor, speed = result["monitor.least_margin"][-1][:3]
    answer = []
    for row in case.rows:
        k = round(row["t"] / INTERVAL)
        bounds = {
            "los": np.array([corridor / np.cos(HALF_ANGLE)]),
            "speed": np.array([SPEED_LIMIT - speed * MINUTE]),
            "box": np.array([BOX + keep_out]),
        }
        motion = {
            "xy": result["controller.rho_H"][k, :2],
            "vxy": result["controller.drho_H"][k, :2] * MINUTE,
        }
        answer.append({name: (bounds | motion)[name] for name in row if name != "t"})
    return answer


def _changes(case: Case) -> dict[str, Any]:
    own = ("mass_0", "rho_0_H", "drho_0_H")
    changes: dict[str, Any] = {f"servicer.{name}": case.setup["parameters"][name] for name in own}
    for phase in (1, 2):
        K = np.array(case.setup[f"K{phase}"])
        changes[f"controller.K_rho_{phase}"] = _in_three(K[:, :2] / MINUTE**2)
        changes[f"controller.K_drho_{phase}"] = _in_three(K[:, 2:] / MINUTE)
    changes["controller.t_abort"] = case.setup["abort_min"] * MINUTE
    return changes | {"monitor.passive_time": 0}


def _in_three(K: Array) -> list[list[float]]:
    full = np.zeros((3, 3))
    full[:2, :2] = K
    return [[float(k) for k in row] for row in full]


# ---- all starts


@dataclass(frozen=True)
class Flight:
    """A flight of a campaign: start [m], abort [s], least margins of box, corridor [m] and speed
    [m/s].
    """

    start: tuple[float, float]
    abort: float
    margins: tuple[float, float, float]

    @property
    def safe(self) -> bool:
        """Whether all three constraints held."""
        return min(self.margins) >= 0


def campaign(instance: Instance, flights: int = 50) -> list[Flight]:
    """Fly corners of the start box and abort interval, then a Sobol sequence in them.

    A campaign finds violations, it does not prove that there are none. Every flight takes about a
    second.
    """
    return [_fly(*sample) for sample, _ in zip(_samples(instance), range(flights), strict=False)]


def _samples(instance: Instance) -> Iterator[tuple[float, float, float]]:
    corners = list(product(*START, dict.fromkeys(instance.abort)))
    yield from corners
    low, high = zip(*START, instance.abort, strict=True)
    while True:
        sobol = qmc.Sobol(3, seed=1).random(1024)
        for share in sobol:
            x, y, abort = np.array(low) + share * (np.array(high) - np.array(low))
            yield float(x), float(y), float(abort)


def _fly(x: float, y: float, abort: float) -> Flight:
    result = fly_system(
        SYSTEM,
        every=90_000,
        set={
            "servicer.rho_0_H": [x, y, 0.0],
            "controller.t_abort": abort * MINUTE,
            "monitor.passive_time": 0,
        },
    )
    keep_out, corridor, speed = (float(m) for m in result["monitor.least_margin"][-1][:3])
    return Flight((x, y), abort * MINUTE, (keep_out, corridor, speed))
