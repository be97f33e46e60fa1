# SPDX-License-Identifier: BSD-2-Clause
"""Several environments of one system in this process, stepped by one call into C."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from harness.learning.environment import Environment
from harness.master.executors import Stretch, execute_all
from harness.results.result import Array


class Environments(VectorEnv[Array, Array, Array]):
    """Vector of environments. One that has ended begins its next episode in the next step, whose
    action it ignores.
    """

    metadata = {**Environment.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int, **arguments: Any) -> None:
        """Create the environments; with `factors` number i begins with run i, and then takes every
        num_envs-th run.
        """
        self.num_envs = num_envs
        self.envs = [Environment(**arguments, stride=num_envs) for _ in range(num_envs)]
        self.render_mode = self.envs[0].render_mode
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in every environment; seed: of the first one, or of each."""
        seeds: list[int | None] = [None] * self.num_envs
        if isinstance(seed, list):
            seeds = seed
        elif seed is not None or not self._begun:
            seeds = [(seed or 0) + i for i in range(self.num_envs)]
        self._begun, self._over[:] = True, False
        found = [e.reset(seed=s, options=options) for e, s in zip(self.envs, seeds, strict=True)]
        self._stretches = (Stretch * self.num_envs)(*(e.simulation.stretch(0) for e in self.envs))
        observations, infos = zip(*found, strict=True)
        return np.array(observations), self._infos(list(infos))

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Hold the actions for `every` macro steps."""
        over = self._over.tolist()
        for env, stretch, action, ended in zip(
            self.envs, self._stretches, actions, over, strict=True
        ):
            stretch.first = env.simulation.step
            stretch.last = stretch.first if ended else env.act(action)
        execute_all(self._stretches)
        found = []
        for i, (env, ended) in enumerate(zip(self.envs, over, strict=True)):
            if ended:
                found.append(self._begin(i))
                continue
            if self._stretches[i].stop.status:
                env.finish(self._stretches[i])
            found.append(env.outcome())
        observations, rewards, terminated, truncated, infos = zip(*found, strict=True)
        lost, out = np.array(terminated), np.array(truncated)
        self._over = lost | out
        return np.array(observations), np.array(rewards), lost, out, self._infos(list(infos))

    def _begin(self, i: int) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        observation, info = self.envs[i].reset()
        self._stretches[i] = self.envs[i].simulation.stretch(0)
        return observation, 0.0, False, False, info

    def _infos(self, infos: list[dict[str, Any]]) -> dict[str, Any]:
        """Return the infos as arrays; margins of requirements, NaN where an episode begins."""
        given = [info.pop("margins", {}) for info in infos]
        names = list(dict.fromkeys(name for margins in given for name in margins))
        table = np.array([[margins.get(name, np.nan) for name in names] for margins in given])
        columns = dict(zip(names, table.T, strict=True))
        merged: dict[str, Any] = {"margins": columns} if names else {}
        for i, info in enumerate(infos):
            if info:
                merged = self._add_info(merged, info, i)
        return merged

    def render(self) -> tuple[Any, ...]:
        """Return a picture of every environment."""
        return tuple(env.render() for env in self.envs)

    def close_extras(self, **_: Any) -> None:
        """Free the FMUs."""
        for env in self.envs:
            env.close()
