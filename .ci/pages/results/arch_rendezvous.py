# SPDX-License-Identifier: BSD-2-Clause
"""Rendezvous with proved safety: table of the instances of the benchmark SPRE of ARCH-COMP."""

from __future__ import annotations

from typing import Any

from results import Column, of_runs

INSTANCES = {
    "SRNA01": ("none", "safe"), "SRA01": ("120", "safe"), "SRA02": ("120 to 125", "safe"),
    "SRA03": ("120 to 145", "safe"), "SRA04": ("240", "safe"), "SRA05": ("235 to 240", "safe"),
    "SRA06": ("230 to 240", "safe"), "SRA07": ("50 to 150", "safe"),
    "SRA08": ("0 to 240", "safe"), "SRU01": ("260", "unsafe"), "SRU02": ("0 to 260", "unsafe"),
}  # fmt: skip
"""Time of the abort [min] (none: no abort) and published verdict, by instance of the benchmark."""


def box(result: Any) -> tuple[float, ...]:
    """Return the least distance [m] between the drifting servicer and the box around the target
    that it must not enter, negative inside, and the time after which there is no thrust [min].
    """
    from ssp.arch_rendezvous import claims

    return claims.box(result)


def verdict(result: Any) -> str:
    """Return "safe" or "unsafe" for a run."""
    return "unsafe" if box(result)[0] < 0 else "safe"


def instances() -> str:
    """Return a table of all instances, with the published verdict and the verdict of the run."""
    runs = {f"{name}, {abort}, {word}": f"arch_rendezvous --params {name} --every 50"
            for name, (abort, word) in INSTANCES.items()}  # fmt: skip
    return of_runs("instance, abort [min], published", runs, [
        Column("least margin to the box [m], no thrust from [min] on", box, "{:.2f}, {:.0f}"),
        Column("here", verdict),
    ])  # fmt: skip


VALUES = {"arch_instances": instances}
