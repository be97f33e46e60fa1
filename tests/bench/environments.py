# SPDX-License-Identifier: BSD-2-Clause
"""Cost of environments: steps beside a plain loop over advance(), resets beside FMUGym on the same
plant, several environments in one process beside one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from harness import environment, export
from harness.learning.vector import Environments
from harness.master.executors import Stretches

ROUNDS, STEPS, RESETS, MANY = 7, 400, 200, 16


def least(*functions: Callable[[], float]) -> list[float]:
    """Return the least value of each function over some rounds, in turn."""
    return [min(values) for values in zip(*([f() for f in functions] for _ in range(ROUNDS)),
                                          strict=True)]  # fmt: skip


def per_call(count: int, function: Callable[[], Any]) -> float:
    """Return the processor time of a call [s]."""
    began = process_time()
    for _ in range(count):
        function()
    return (process_time() - began) / count


def bench(name: str) -> Iterator[str]:
    """Yield the lines of the table for a system."""
    env: Any = environment(name, ends=())
    many = Environments(MANY, system=name, ends=())
    rest = 0.5 * (env.action_space.low + env.action_space.high)
    all_rest = np.tile(rest, (MANY, 1))

    def plain() -> float:
        env.reset()
        return per_call(STEPS, lambda: env.simulation.advance(env.simulation.step + env.every))

    def steps() -> float:
        env.reset()
        return per_call(STEPS, lambda: env.step(rest))

    def together() -> float:
        many.reset()
        return per_call(STEPS, lambda: many.step(all_rest)) / MANY

    def macro_steps() -> float:
        many.reset()
        with patch.object(Stretches, "execute", timed):
            spent.clear()
            per_call(STEPS, lambda: many.step(all_rest))
        return sum(spent) / (STEPS * MANY)

    spent: list[float] = []
    execute = Stretches.execute

    def timed(stretches: Stretches) -> None:
        began = process_time()
        execute(stretches)
        spent.append(process_time() - began)

    for function in (plain, steps, together):  # memory, caches
        function()
    a, b, c, loop = least(plain, steps, together, macro_steps)
    (reset,) = least(lambda: per_call(RESETS, env.reset))
    yield f"{name}: environment of {env.every} macro steps per action, one core"
    yield f"plain loop over advance()    {1e6 * a:8.1f} us per action"
    yield f"environment                  {1e6 * b:8.1f} us, {a / b:.2f} of the plain rate"
    yield f"{MANY} in one process           {1e6 * c:8.1f} us each, {b / c:.2f} of {MANY} times one"
    yield f"macro steps alone           {1e6 * loop:8.1f} us, {100 * loop / c:.0f} %"
    yield f"reset                        {1e6 * reset:8.1f} us"
    other = fmugym(name)
    if other is None:
        yield "FMUGym: not installed"
    else:
        yield f"reset of FMUGym              {1e6 * other:8.1f} us, {other / reset:.0f} times"
    many.close()
    env.close()


def fmugym(name: str) -> float | None:
    """Return the time of a reset of FMUGym with the system as one FMU [s]; None without it."""
    try:
        from fmugym import FMUGym
    except ImportError:
        return None

    class Plant(FMUGym):  # type: ignore[misc]
        """The system as one FMU, whose outputs are observed."""

        def _noisy_init(self) -> dict[int, float]:
            return {}

        def compute_reward(self, *_: Any) -> float:
            """Return no reward."""
            return 0.0

    with TemporaryDirectory() as folder:
        nothing = SimpleNamespace(variables={})
        about = dict.fromkeys(("inputs", "input_noise", "output_noise", "random_vars"), nothing)
        bounds = SimpleNamespace(low=[0.0], high=[1.0])
        seen = {f"servicer.r_SN_N[{i}]": bounds for i in (1, 2, 3)}
        made = Plant(
            SimpleNamespace(
                fmu_path=str(export(name, Path(folder) / "plant.fmu")),
                start_time=0.0,
                stop_time=100.0,
                sim_step_size=0.1,
                action_step_size=1.0,
                outputs=SimpleNamespace(variables=seen),
                **about,
            )
        )
        (seconds,) = least(lambda: per_call(5, made.reset))
        made.close()
        return seconds
