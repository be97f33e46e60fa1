# SPDX-License-Identifier: BSD-2-Clause
"""Tables of the flexible servicer: panels and slosh in several systems; comparison with the rigid
servicer on thrusters; effect of notch filters.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs

SWAP = "--swap servicer=flexible_servicer"
SYSTEMS = {
    "`sync_approach`": f"sync_approach {SWAP}",
    "the same, `ppc_controller`": f"sync_approach {SWAP} --swap controller=ppc_controller",
    "the same, `pid_controller`": f"sync_approach {SWAP} --swap controller=pid_controller",
    "the same, `theta_d_controller`": f"sync_approach {SWAP} --swap controller=theta_d_controller",
    "`sync_approach_navigated`": f"sync_approach_navigated {SWAP}",
    "`sync_approach_thrusters`": f"sync_approach_thrusters {SWAP}",
    "`relay_approach`": f"relay_approach {SWAP} --every 10",
    "`ppc_tracking`": f"ppc_tracking {SWAP}",
}
THRUSTERS = {
    "`relay_approach`": "relay_approach --every 10",
    "`relay_approach_navigated`, 4000 s": "relay_approach_navigated --stop 4000",
    "`sync_approach_thrusters`, `pulsed`": "sync_approach_thrusters --params pulsed",
    "`sync_approach_thrusters_navigated`, `pulsed`, 900 s":
        "sync_approach_thrusters_navigated --params pulsed --stop 900",
}  # fmt: skip
LATE = "ppc_tracking_notched --swap servicer=flexible_servicer --latency controller=1"
WINGS = (3.0, 4.0, 5.5)
"""Frequencies of a wing on a fixed hub [Hz]."""
TURNING, SHIFTING = 1.3427, 1.0687
"""Frequencies of the free antisymmetric and symmetric modes of two wings, divided by the frequency
of a wing on a fixed hub (docs/models.md L.4).
"""
VIBRATION = [
    Column("wings, largest [mrad]", "panel angle", "{:.2g}"),
    Column("in the last fifth [mrad]", "residual vibration", "{:.2g}"),
    Column("slosh, largest [m]", "slosh", "{:.2g}"),
]
ERROR = Column("attitude error [deg]", "attitude error", "{:.3g}")


def alarmed(result: Any) -> str:
    """Return "yes" if a sloshing mass has been outside its tank, where its model is not valid;
    otherwise "no".
    """
    return "yes" if result["servicer.slosh_beyond_travel"].any() else "no"


def in_systems() -> str:
    """Return a table of the effect of panels and slosh, system by system."""
    shift = Column("centre of mass from S, largest [m]", "max(norm(servicer.r_CS_S))", "{:.2g}")
    return of_runs("system", SYSTEMS, [*VIBRATION, Column("slosh alarm", alarmed), shift])


def on_thrusters() -> str:
    """Return a table of the rigid and the flexible servicer on thrusters."""
    runs: dict[str, str] = {}
    for name, command in THRUSTERS.items():
        runs |= {f"{name}: rigid": command, f"{name}: flexible": f"{command} {SWAP}"}
    return of_runs("system", runs, [*VIBRATION, ERROR])


def notched(hertz: float, torque: bool, force: bool) -> str:
    """Return the text after `harness run` for a run of LATE. hertz: frequency of a wing on a fixed
    hub [Hz]; torque: whether the commanded torque is filtered by a notch at the free antisymmetric
    mode; force: whether the commanded force is filtered by a notch at the free symmetric mode.
    """
    wing = 2 * np.pi * hertz
    at = {"servicer.panel_frequency": f"[{','.join([f'{wing:.5g}'] * 4)}]",
          "filter.frequency": f"[{TURNING * wing * torque:.5g},0]",
          "filter.force_frequency": f"[{SHIFTING * wing * force:.5g},0]"}  # fmt: skip
    return f"{LATE} {' '.join(f'--set {name}={value}' for name, value in at.items())}"


def modes(result: Any) -> tuple[float, float]:
    """Return the amplitudes of the antisymmetric and the symmetric mode of the two wings [mrad]:
    the largest half sum and half difference of their angles in the last quarter of the run.
    """
    late = result["servicer.panel_angle"][result.time >= 0.75 * result.time[-1]]
    half = np.abs(late[:, 0] + late[:, 1]).max() / 2, np.abs(late[:, 0] - late[:, 1]).max() / 2
    return 1e3 * half[0], 1e3 * half[1]


def last_quarter(result: Any) -> float:
    """Return the largest attitude error in the last quarter of the run [deg]."""
    from ssp.shared.relative_motion import attitude_error

    error = attitude_error(result)
    return float(np.degrees(error[result.time[: len(error)] >= 0.75 * result.time[-1]].max()))


def notches() -> str:
    """Return a table of runs with wings of three frequencies, each with no notch, and with notches
    in torque, in force, and in both.
    """
    words = {"none": (False, False), "torque": (True, False), "force": (False, True),
             "both": (True, True)}  # fmt: skip
    runs = {f"{hertz:g} Hz: {word}": notched(hertz, *chosen)
            for hertz in WINGS for word, chosen in words.items()}  # fmt: skip
    return of_runs("wings: notches at the free mode in", runs, [
        Column("error [deg]", last_quarter, "{:.2g}"),
        Column("antisymmetric, symmetric [mrad]", modes, "{:.3g}, {:.3g}"),
        Column("torque impulse [N m s]", "torque impulse", "{:.0f}"),
    ])  # fmt: skip


VALUES = {
    "flexible_systems": in_systems,
    "flexible_thrusters": on_thrusters,
    "flexible_notches": notches,
}
