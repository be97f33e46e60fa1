# SPDX-License-Identifier: BSD-2-Clause
"""Environment whose third-party FMUs run in a child process: a crash ends an episode, not the
training.
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


def trusted(system: str | Path, how: Mapping[str, Any]) -> bool:
    """Return whether all FMUs of an environment are of the project."""
    given: Changes = {"swap": how.get("swap", ()), "map": how.get("map", ())}
    with load(system) as found:
        return all_ours(apply(found, **given))


def environment(system: str | Path, **how: Any) -> Environment | Apart:
    """Return an environment, in a child process if one of its FMUs is third-party."""
    return Environment(system, **how) if trusted(system, how) else Apart(system, **how)


class Apart(gymnasium.Env[Array, Array], EzPickle):
    """Environment as seen from the parent, see harness.environment()."""

    metadata = Environment.metadata

    def __init__(self, system: Any, **how: Any) -> None:
        EzPickle.__init__(self, system, **how)
        self._order, self._life = (system, how), ExitStack()
        self.render_mode = how.get("render_mode")
        self._begin()
        self._observation: Any = None
        self._run: int | None = None

    def _begin(self) -> None:
        """Start the child, which creates the environment; raise its errors."""
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
        self._pipe.send((name, arguments, named))
        return self._answer()

    def _answer(self) -> Any:
        """Return the answer of the child; raise its error, or FmuError if it has ended."""
        if self._pipe in wait([self._pipe, self._child.process.sentinel]):
            try:
                error, value = self._pipe.recv()
            except (EOFError, OSError):
                error, value = None, None
            else:
                if error is not None:
                    raise error
                return value
        self._child.process.join()
        instance, call = self._child.place
        raise FmuError(f"{instance}: {call} {self._child.end()}")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, in a new process if the last one has ended."""
        super().reset(seed=seed)
        if not self._child.process.is_alive():
            self._begin()
            if seed is None and self._run is not None:  # the new process does not know it
                options = {"run": self._run + self._order[1].get("stride", 1), **(options or {})}
        self._observation, info = self._call("reset", seed=seed, options=options)
        self._run = info.get("run")
        return self._observation, info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for `every` macro steps. If the child process ends, the episode is
        terminated.
        """
        try:
            found: tuple[Array, float, bool, bool, dict[str, Any]] = self._call("step", action)
        except (FmuError, BrokenPipeError) as error:
            return self._observation, 0.0, True, False, {"ended": [str(error)], "margins": {}}
        self._observation = found[0]
        return found

    def result(self) -> Result:
        """Return the episode so far as the result of a run; raise FmuError without a process."""
        found: Result = self._call("result")
        return found

    def render(self) -> Any:
        """Return a picture."""
        return self._call("render")

    def close(self) -> None:
        """End the child."""
        self._life.close()


SHOWN = ("observation_space", "action_space", "observation_names", "action_names", "every")


def _serve(_: Send, pipe: Connection, system: Any, how: dict[str, Any]) -> None:
    """Answer calls of methods until the parent closes the pipe."""

    def answer(function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        value: Any = None
        error: Exception | None = None
        try:
            value = function(*arguments, **named)
        except HarnessError as found:
            error = found
        except Exception as found:  # other exceptions may not be picklable
            error = RuntimeError(f"{type(found).__name__}: {found}")
        pipe.send((error, None if isinstance(value, Environment) else value))
        return value

    env = answer(Environment, system, **how)
    with suppress(EOFError):
        while env is not None:
            name, arguments, named = pipe.recv()
            found = getattr(env, name)
            answer(found if callable(found) else lambda found=found: found, *arguments, **named)
