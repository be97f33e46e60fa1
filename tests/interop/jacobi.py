# SPDX-License-Identifier: BSD-2-Clause
"""Our run as masters without a schedule execute a system: Jacobi, every component at every step."""

from __future__ import annotations

from dataclasses import replace

from harness import load
from harness.master.simulation import Simulation


def jacobi(path, steps):
    """Return the result of a system after so many macro steps, every one recorded."""
    with load(path) as system:
        start, step = system.experiment.start, system.experiment.step
        components = tuple(replace(c, every=1, latency=0) for c in system.components)
        times = {"stop": start + steps * step, "algorithm": "jacobi", "every": 1}
        system = replace(
            system, components=components, experiment=replace(system.experiment, **times)
        )
        with Simulation(system) as simulation:
            simulation.advance()
            return simulation.result()
