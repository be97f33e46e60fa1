# SPDX-License-Identifier: BSD-2-Clause
"""Master algorithm as data: the actions on the instances of FMUs, and their order in every macro
step.

An instance with `every = N` makes steps that are N macro steps long; a step begins in every macro
step k with k % N == 0. The outputs of an instance with `latency = L` are published L macro steps
later than without latency, as a computer needs time for its results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from harness.errors import StructureError
from harness.system.model import Experiment

MOST = 2**31 - 1
"""Largest number of macro steps in one step of an instance, and largest latency."""


NOT_FINITE, TOO_WIDE, TERMINATION, EARLY_RETURN = -1, -2, -3, -4
"""Statuses of loop.c besides the statuses of FMI. NOT_FINITE: an output is not a finite number.
TOO_WIDE: an output is a whole number that a double on the bus cannot represent. TERMINATION: a step
requests termination. EARLY_RETURN: a step has returned early.
"""


class Verb(Enum):
    """Action on an instance. SET: copy values from the bus to its inputs; STEP: perform a step;
    GET: copy its outputs to the bus.
    """

    SET = "set"
    STEP = "step"
    GET = "get"

    def call(self, fmi: int = 2) -> str:
        """Return the name of the FMI function that performs this action, for SET and GET the
        function of type Real; fmi: version of FMI, 2 or 3.
        """
        real = "Real" if fmi == 2 else "Float64"
        done = {"set": f"Set{real}", "step": "DoStep", "get": f"Get{real}"}[self.value]
        return f"fmi{fmi}{done}"


class Periodic(Protocol):
    """Properties of an instance that a schedule needs: name, period and latency."""

    @property
    def name(self) -> str:
        """Name of the component."""

    @property
    def every(self) -> int:
        """Return the number of macro steps per step of the instance."""

    @property
    def latency(self) -> int:
        """Return the number of macro steps by which the outputs are published late."""


Scheduled = TypeVar("Scheduled", bound=Periodic)


class Action(NamedTuple, Generic[Scheduled]):
    """Action `verb` on `instance` at every macro step k with k % every == phase."""

    verb: Verb
    instance: Scheduled
    every: int = 1
    phase: int = 0

    def due(self, k: int) -> bool:
        """Return whether the action is due in macro step k."""
        return k % self.every == self.phase


def gauss_seidel(instances: Sequence[Scheduled]) -> list[Action[Scheduled]]:
    """Return the schedule in which one instance after the other reads the newest outputs, steps,
    and publishes its outputs at once.

    An instance with latency L (at most its period) publishes at the beginning of the macro step
    that is L macro steps after the macro step in which it has read its inputs.
    """
    late = [Action(Verb.GET, i, i.every, i.latency % i.every) for i in instances if i.latency]
    return late + [
        Action(verb, i, i.every)
        for i in instances
        for verb in Verb
        if not (verb is Verb.GET and i.latency)
    ]


def jacobi(instances: Sequence[Scheduled]) -> list[Action[Scheduled]]:
    """Return the schedule in which all instances read, then all step, and each publishes its
    outputs at the end of its step.

    An instance with latency 1 publishes one macro step later, after the other instances have read
    and before its own next step.
    """
    read = [Action(Verb.SET, i, i.every) for i in instances]
    late = [Action(Verb.GET, i, i.every) for i in instances if i.latency]
    step = [Action(Verb.STEP, i, i.every) for i in instances]
    publish = [Action(Verb.GET, i, i.every, i.every - 1) for i in instances if not i.latency]
    return read + late + step + publish


class _Algorithm(NamedTuple):
    plan: Callable[[Sequence[Any]], list[Any]]
    largest_latency: Callable[[Periodic], int]


ALGORITHMS = {
    "gauss-seidel": _Algorithm(gauss_seidel, lambda instance: instance.every),
    "jacobi": _Algorithm(jacobi, lambda instance: 1),
}


def problems(algorithm: str, instances: Sequence[Periodic]) -> list[str]:
    """Return the problems of the periods and latencies of instances under an algorithm, one line
    each.
    """
    if algorithm not in ALGORITHMS:
        return [f"algorithm: there is no {algorithm}, only {' and '.join(ALGORITHMS)}"]
    largest = ALGORITHMS[algorithm].largest_latency
    found = []
    for i in instances:
        if not 1 <= i.every <= MOST:
            found.append(f"{i.name}: `every` must lie in 1..{MOST}, not {i.every}")
        elif not 0 <= i.latency <= largest(i):
            limits = f"must lie in 0..{largest(i)} macro steps under {algorithm}"
            found.append(f"{i.name}: latency {limits}, not {i.latency}")
    return found


def schedule(algorithm: str, instances: Sequence[Scheduled]) -> list[Action[Scheduled]]:
    """Return the actions of every macro step, in order; raise StructureError if the algorithm does
    not exist or does not support a period or latency.
    """
    if found := problems(algorithm, instances):
        raise StructureError(found)
    return ALGORITHMS[algorithm].plan(instances)


def macro_steps(experiment: Experiment, periods: Sequence[int] = (1,)) -> int:
    """Return the number of macro steps of an experiment in which every component takes whole steps.

    periods: `every` of the components. Raises StructureError if step or stop time is missing or
    invalid, or if the time span is not a multiple of the steps of all components.
    """
    start, stop, step = experiment.start, experiment.stop, experiment.step
    cycle = math.lcm(*periods)
    if problem := _time_problem(start, stop, step, cycle):
        raise StructureError([problem])
    assert stop is not None
    assert step is not None
    cycles = round((stop - start) / (cycle * step))
    if cycles < 1 or abs(start + cycles * cycle * step - stop) > 1e-9 * max(abs(stop), step):
        raise StructureError([_not_a_multiple(start, stop, step, cycle)])
    return cycles * cycle


def _time_problem(start: float, stop: float | None, step: float | None, cycle: int) -> str | None:
    """Return why stop time or macro step is missing or invalid, None if both are valid, even if the
    time span is no multiple of the steps; cycle: number of macro steps after which all components
    begin a step together.
    """
    if step is None and stop is None:
        return "the system defines neither macro step nor stop time: set both with --step, --stop"
    if step is None or not (step > 0 and math.isfinite(step)):
        needed = f"must be a positive number of seconds, not {step}"
        return f"the macro step {needed}: give one with --step"
    if stop is None or not (stop > start and math.isfinite(stop)):
        needed = f"must lie after the start time {start:g} s, not at {stop}"
        return f"the stop time {needed}: give one with --stop"
    if not (stop - start) / cycle / step < 2**53:
        reason = f"is too many macro steps of {step:.12g} s after the start"
        return f"the stop time {stop:.12g} s {reason}: give other values by --step and --stop"
    return None


def _not_a_multiple(start: float, stop: float, step: float, cycle: int) -> str:
    below = math.floor((stop - start) / (cycle * step))
    near = " and ".join(f"{start + n * cycle * step:.12g} s" for n in (below, below + 1) if n > 0)
    whole = f"the macro step {step:.12g} s"
    if cycle > 1:
        whole = f"{cycle} macro steps of {step:.12g} s (common period of all components)"
    return f"the stop time {stop:.12g} s is not a multiple of {whole}; nearest: {near}"
