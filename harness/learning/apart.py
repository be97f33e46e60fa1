# SPDX-License-Identifier: BSD-2-Clause
"""Environment that runs in a child process, for systems with third-party FMUs. If an FMU crashes,
only the episode ends, not the training.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.utils import EzPickle

from harness.errors import FmuError, HarnessError
from harness.learning.environment import Environment
from harness.master.changes import Changes, apply
from harness.master.child import Child, Send
from harness.master.isolated import all_ours
from harness.results.result import Array, Result
from harness.ssp.library import load
from harness.studies.campaign.draft import read_plan


def trusted(system: str | Path, how: Mapping[str, Any]) -> bool:
    """Return whether all FMUs of an environment belong to this package, so that none can crash.
    With a campaign that swaps FMUs the result is False.

    how: arguments of the environment.
    """
    if factors := how.get("factors"):
        table = read_plan(factors)[0].table
        if table.fixed.swap or any(name.startswith("swap.") for name in table.factors):
            return False
    given: Changes = {"swap": how.get("swap", ()), "map": how.get("map", ())}
    with load(system) as found:
        return all_ours(apply(found, **given))


def environment(system: str | Path, **how: Any) -> Environment | Apart:
    """Return an environment, which runs in a child process if one of its FMUs is third-party.

    how: arguments as for harness.environment().
    """
    return Environment(system, **how) if trusted(system, how) else Apart(system, **how)


class Apart(gymnasium.Env[Array, Array], EzPickle):
    """Environment in a child process, with the arguments of Environment and its methods reset(),
    step(), result() and close(). The first three are performed by the child.
    """

    def __init__(self, system: Any, **how: Any) -> None:
        EzPickle.__init__(self, system, **how)
        self._order, self._life = (system, how), ExitStack()
        self._begin()
        self._observation: Any = None
        self._run: int | None = None

    def _begin(self) -> None:
        """Start the child process, which creates the environment; raise the error if that fails."""
        self._life.close()
        self._pipe, theirs = Pipe()
        child = Child(_serve, theirs, *self._order, open_files=(theirs.fileno(),))
        self._child = self._life.enter_context(child)
        theirs.close()
        self._life.callback(self._pipe.close)
        self._answer()
        for name in SHOWN:
            setattr(self, name, self._call(name))

    def _call(self, name: str, *arguments: Any, **named: Any) -> Any:
        with suppress(BrokenPipeError):  # the child has ended: _answer() raises
            self._pipe.send((name, arguments, named))
        return self._answer()

    def _answer(self) -> Any:
        """Return the answer of the child process to the last call; raise the error that the call
        raised there, or FmuError if the process has ended.
        """
        if self._pipe in wait([self._pipe, self._child.process.sentinel]):
            with suppress(EOFError, OSError):
                error, value = self._pipe.recv()
                if error is not None:
                    raise error
                return value
        self._child.process.join()
        instance, call = self._child.place
        raise FmuError(f"{instance}: {call} {self._child.end()}")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, in a new child process if the earlier one has ended."""
        super().reset(seed=seed)
        if not self._child.process.is_alive():
            self._begin()
            # a new process does not know the number of the last run, so the next number is passed
            if seed is None and self._run is not None:
                options = {"run": self._run + self._order[1].get("stride", 1), **(options or {})}
        self._observation, info = self._call("reset", seed=seed, options=options)
        self._run = info.get("run")
        return self._observation, info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Apply an action for `every` macro steps. If the child process ends, the episode is
        terminated, with the last observation and reward 0.
        """
        try:
            found: tuple[Array, float, bool, bool, dict[str, Any]] = self._call("step", action)
        except FmuError as error:
            return self._observation, 0.0, True, False, {"ended": [str(error)], "margins": {}}
        self._observation = found[0]
        return found

    def result(self) -> Result:
        """Return the episode so far as the result of a run; raise FmuError if the child process has
        ended.
        """
        found: Result = self._call("result")
        return found

    def close(self) -> None:
        """End the child process."""
        self._life.close()


SHOWN = ("observation_space", "action_space", "observation_names", "action_names", "every")
"""Attributes of the environment that are copied from the child process."""


def _serve(_: Send, pipe: Connection, system: Any, how: dict[str, Any]) -> None:
    """Create the environment in the child process, and perform the calls that arrive in the pipe
    until the parent process closes it. Answers are pairs (error or None, value).
    """

    def answer(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        value: Any = None
        error: Exception | None = None
        try:
            value = function(*arguments, **named)
        except HarnessError as found:
            error = found
        except Exception as found:  # sent as text, because it may not be picklable
            error = RuntimeError(f"{type(found).__name__}: {found}")
        pipe.send((error, None if isinstance(value, Environment) else value))
        return value

    env = answer(Environment, system, **how)
    with suppress(EOFError):
        while env is not None:
            name, arguments, named = pipe.recv()
            found = getattr(env, name)
            answer(found if callable(found) else lambda found=found: found, *arguments, **named)
