# SPDX-License-Identifier: BSD-2-Clause
"""Vector of several environments of one system. If all FMUs belong to this package, one call into C
performs the macro steps of all environments, else each environment runs in a child process.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

from harness.learning.apart import environment, trusted
from harness.learning.environment import Environment
from harness.master.executors import Stretches
from harness.results.result import Array


def environments(num_envs: int, system: str | Path, **how: Any) -> VectorEnv[Array, Array, Array]:
    """Return a vector of environments of one system. If the system has third-party FMUs, each
    environment runs in a child process.

    how: arguments as for harness.environment().
    """
    if trusted(system, how):
        return Environments(num_envs, system=system, **how)
    each = partial(environment, system, stride=num_envs, **how)
    return SyncVectorEnv([partial(each, begin=i) for i in range(num_envs)])


class Environments(VectorEnv[Array, Array, Array]):
    """Vector of environments. An environment whose episode has ended ignores the next action and
    begins a new episode instead.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int, **arguments: Any) -> None:
        """Create the environments. With a campaign (`factors`), the episodes of environment i start
        as the runs i, i + num_envs, i + 2 num_envs, ... of the campaign.

        arguments: as for harness.environment().
        """
        self.num_envs = num_envs
        self.envs = [Environment(**arguments, stride=num_envs) for _ in range(num_envs)]
        first = self.envs[0]
        self._spaces, self._scoring = first.spaces, first.scoring
        self.single_observation_space = first.observation_space
        self.single_action_space = first.action_space
        self.observation_space = batch_space(first.observation_space, num_envs)
        self.action_space = batch_space(first.action_space, num_envs)
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in every environment. seed: seed of the first environment (environment i
        has seed + i), or a list with one seed per environment.
        """
        seeds: list[int | None] = [None] * self.num_envs
        if isinstance(seed, list):
            seeds = seed
        elif seed is not None or not self._begun:
            seeds = [(seed or 0) + i for i in range(self.num_envs)]
        self._begun, self._over[:] = True, False
        found = [e.reset(seed=s, options=options) for e, s in zip(self.envs, seeds, strict=True)]
        self._stretches = Stretches([env.simulation.stretch(0) for env in self.envs])
        self._spent = np.array([env.spent for env in self.envs])
        observations, infos = zip(*found, strict=True)
        return np.array(observations), self._infos({}, enumerate(infos))

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Apply one action per environment for `every` macro steps; return by environment:
        observations, rewards, whether the episode was terminated, whether it reached the stop time,
        and further data.
        """
        begun, commands = self._over, self._spaces.commands(actions)
        first = [env.simulation.step for env in self.envs]
        for env, stretch, command, now, ended in zip(
            self.envs, self._stretches.each, commands, first, begun.tolist(), strict=True
        ):
            stretch.first, stretch.last = now, now if ended else env.put(command, now)
        self._stretches.execute()
        failed = [e.failed(s) for e, s in zip(self.envs, self._stretches.each, strict=True)]
        single = {i: self._begin(i) for i in np.flatnonzero(begun).tolist()}
        values = np.array([env.values() for env in self.envs])
        rewards = np.where(begun, 0.0, values[:, 0] - (values[:, 1] - self._spent))
        self._spent = values[:, 1]
        lost = ~begun & (failed | (values[:, 2] != 0))
        out = ~lost & np.array([env.simulation.step >= env.simulation.steps for env in self.envs])
        self._over = lost | out
        for i in np.flatnonzero(self._over).tolist():
            single[i] = self.envs[i].ending(values[i].tolist())
        seen = self._spaces.seen(np.array([env.simulation.bus for env in self.envs]))
        columns = np.where(begun[:, None], np.nan, values).T
        infos: dict[str, Any] = {"margins": self._scoring.margins(columns)}
        if self.envs[0].intervention:
            infos |= {"intervention": columns[3], "_intervention": ~begun}
        return seen, rewards, lost, out, self._infos(infos, single.items())

    def _begin(self, i: int) -> dict[str, Any]:
        _, info = self.envs[i].reset()
        self._stretches.all[i] = self.envs[i].simulation.stretch(0)
        return info

    def _infos(
        self, infos: dict[str, Any], single: Iterable[tuple[int, dict[str, Any]]]
    ) -> dict[str, Any]:
        """Return further data of all environments (`infos`), extended by the data of single
        environments, in the form of Gymnasium: arrays with an element per environment. single:
        pairs of the index of an environment and its data.
        """
        for i, info in single:
            infos = self._add_info(infos, info, i)
        return infos

    def close_extras(self, **_: Any) -> None:
        """Free the FMUs of all environments."""
        for env in self.envs:
            env.close()
