# SPDX-License-Identifier: BSD-2-Clause
"""Closed loop of the safety filter with hostile policies: cases of docs/models.md M, random starts
with all barriers positive. The filter is the C code of the FMU, the world is filter_loop.c.

    python -m tests.reference.filter_runs 12558      all cases, so many runs together
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.compiled import CACHE

from .safety_filter import Inputs, Settings

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(__file__).with_name("filter_loop.c")
FOLDERS = ("core/adapter", "core/maths", "core/models", "core/ports", "flight")
POLICIES = (
    "random", "bang-bang", "at the target", "along v", "against the least barrier", "strong PD",
    "gentle PD",
)  # fmt: skip
AT_TARGET, GENTLE = 2, 6
RUN = (
    "policy", "seed", "duration", "mass", "rate_T", "rate_S", "nearest", "farthest", "speed",
    "error", "delay", "lag",
)  # fmt: skip
WORLD = ("error", "delay", "lag")
OUTCOME = ("relaxed", "changed", "samples", "impulse_passed", "changed_impulse", "arrival", "began")


@dataclass(frozen=True)
class Case:
    """A case: parameters of the filter, and of its world (world: error, delay and lag)."""

    parameters: dict = field(default_factory=dict)
    duration: float = 300
    rate_T: float = 0.005
    nearest: float = 4.05
    farthest: float = 9.5
    speed: float = 0.1
    world: dict = field(default_factory=dict)


SMALL = {
    "F_max": (2, 1, 1), "use_corridor": 1, "corridor_half_angle": np.radians(20),
    "corridor_length": 10, "use_speed_limit": 1, "speed_at_zero": 0.05, "speed_slope": 0.0125,
    "speed_max": 0.12, "brake_keep_out": 2.5e-3, "brake_corridor": 2.5e-3, "sample_period": 0.5,
}  # fmt: skip
ALL = SMALL | {
    "F_max": (2, 2, 2), "speed_max": 0.15, "brake_keep_out": 3e-3, "brake_corridor": 3e-3,
}  # fmt: skip
SPEED = {
    "use_speed_limit": 1, "speed_at_zero": 0.05, "speed_slope": 0.0125, "speed_max": 0.2,
    "F_max": (2, 1, 1), "brake_keep_out": 2.5e-3, "sample_period": 1,
}  # fmt: skip
PPC = {
    "F_max": (490, 490, 490), "keep_out_radius": 17, "brake_keep_out": 4.3 / np.sqrt(3),
    "use_speed_limit": 1, "speed_at_zero": 2, "speed_slope": 0.2325581395348837, "a_dist": 1e-3,
    "speed_max": 10.7, "recover_speed": 0.5, "sample_period": 0.1,
}  # fmt: skip
CASES = {
    "small_05": Case(SMALL),
    "late_05": Case(SMALL | {"reaction": 0.8}, world={"delay": 0.5, "lag": 0.3}),
    "all_05": Case(ALL, rate_T=0.008),
    "all_01": Case(ALL | {"sample_period": 0.1}, duration=120, rate_T=0.008),
    "sphere_1": Case({"sample_period": 1}, duration=600, farthest=30, speed=0.4),
    "speed_1": Case(SPEED, farthest=20, speed=0.2),
    "ppc_01": Case(PPC, duration=60, nearest=17.5, farthest=60, speed=10),
    "passive_1": Case(
        {"sample_period": 1, "passive_time": 600}, duration=600, nearest=5, farthest=30, speed=0.1
    ),
}
WEAK = Case(SMALL, rate_T=0.0102)
"""(26) does not hold."""
SHARES = {"small_05": 3, "late_05": 3, "all_05": 3, "all_01": 1, "sphere_1": 4, "speed_1": 3,
          "ppc_01": 1, "passive_1": 0.3}  # fmt: skip
"""Runs by case, relative."""


class Loop:
    """The compiled loop, once for all workers and later runs: stored by the hash of its sources."""

    def __init__(self) -> None:
        folders = [ROOT / "fmus" / name for name in FOLDERS]
        sources = sorted({SOURCE, *(p for folder in folders for p in folder.glob("*.[ch]"))})
        about = b"".join(path.read_bytes() for path in sources)
        library = CACHE / f"filter_loop_{sha256(about).hexdigest()[:16]}.so"
        if not library.exists():
            self.compile(folders, library)
        self.library = ctypes.CDLL(str(library))

    @staticmethod
    def compile(folders: list[Path], library: Path) -> None:
        CACHE.mkdir(parents=True, exist_ok=True)
        flags = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
        command = [*os.environ.get("CC", "cc").split(), *flags, *(f"-I{f}" for f in folders)]
        with TemporaryDirectory(dir=CACHE) as folder:  # its name comes when it is whole
            made = Path(folder) / library.name
            subprocess.run([*command, SOURCE, "-o", made, "-lm"], check=True)
            made.replace(library)

    def put(self, name: str, value) -> None:
        values = np.atleast_1d(np.asarray(value, float))
        given = values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        assert self.library.put(name.encode(), given), f"no parameter {name}"

    def nearest(self, n, c, u_0, tol: float) -> tuple[np.ndarray, int]:
        """Return the point of the half spaces n.u >= c nearest to u_0, and the excluded row or
        -1.
        """
        rows, start = np.column_stack((n, c)).astype(float), np.asarray(u_0, float)
        found, kind = np.zeros(3), ctypes.POINTER(ctypes.c_double)
        given = [np.ascontiguousarray(a).ctypes.data_as(kind) for a in (rows, start, found)]
        excluded = self.library.nearest(
            given[0], len(rows), given[1], ctypes.c_double(tol), given[2]
        )
        return found, excluded

    def part(self, name: str, p: Settings, u: Inputs, *vectors) -> tuple[np.ndarray, int]:
        """Return what a part of a sample writes, and the number that it returns."""
        self.set(Case(asdict(p)))
        state = [np.asarray(value, float).ravel() for value in vars(u).values()]
        found = np.zeros(4 * 26)
        numbers = (np.concatenate(state), *(np.array(v, float) for v in vectors), found)
        kind = ctypes.POINTER(ctypes.c_double)
        count = getattr(self.library, name)(*(a.ctypes.data_as(kind) for a in numbers))
        return found, count

    def set(self, case: Case, **changes) -> None:
        """Set all parameters: the start values, over them the case and the changes."""
        for name, value in (asdict(Settings()) | case.parameters | changes).items():
            self.put(name, value)

    def run(self, **values: float) -> dict[str, np.ndarray | float]:
        run = (ctypes.c_double * len(RUN))(*(values[name] for name in RUN))
        outcome = (ctypes.c_double * (4 + len(OUTCOME)))()
        self.library.simulate(run, outcome)
        found = np.array(outcome)
        return {"margin": found[:4]} | dict(zip(OUTCOME, found[4:], strict=True))


def runs_of(
    loop: Loop, case: Case, count: int, seed: int = 1, policies=range(7), **changes
) -> Iterator[dict]:
    """Yield the outcomes of runs whose policies take turns. changes: of the parameters, and of the
    world: error (1: the bounds that are the parameters), delay and lag [s].
    """
    world = {name: changes.pop(name, case.world.get(name, 0)) for name in WORLD}
    loop.set(case, **changes)
    parameters = {"mass": 100, "mass_error": 0.1} | case.parameters | changes
    rng = np.random.default_rng([seed, count])
    for k in range(count):
        light = rng.choice((-1, 1))
        yield loop.run(
            policy=list(policies)[k % len(policies)],
            seed=float(rng.integers(1, 2**50)),
            duration=case.duration,
            mass=parameters["mass"] * (1 + light * parameters["mass_error"]),
            rate_T=case.rate_T,
            rate_S=rng.uniform(0, 0.01),
            nearest=case.nearest,
            farthest=case.farthest,
            speed=case.speed,
            **world,
        )


@dataclass(frozen=True)
class Summary:
    """Runs, how many violated sphere, corridor and speed limit, least margins, runs with a relaxed
    sample, share of changed samples, impulses [N s] per run.
    """

    runs: int
    violations: tuple
    least: tuple
    relaxed: int
    changed: float
    impulse_passed: float
    impulse: float


def summary(outcomes) -> Summary:
    """Return the summary of runs that began."""
    began = [o for o in outcomes if o["began"]]
    margins = np.array([o["margin"] for o in began])
    return Summary(
        len(began),
        tuple(int(n) for n in np.sum(margins[:, :3] < 0, axis=0)),
        tuple(float(m) for m in margins.min(axis=0)),
        sum(o["relaxed"] > 0 for o in began),
        100 * sum(o["changed"] for o in began) / sum(o["samples"] for o in began),
        float(np.mean([o["impulse_passed"] for o in began])),
        float(np.mean([o["changed_impulse"] for o in began])),
    )


def main(total: int) -> None:
    """Run all cases and print a line per case."""
    loop = Loop()
    for name, share in SHARES.items():
        count = round(total * share / sum(SHARES.values()) / 7) * 7
        print(name, summary(runs_of(loop, CASES[name], count)), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
