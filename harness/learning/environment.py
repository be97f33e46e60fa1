# SPDX-License-Identifier: BSD-2-Clause
"""Environment of Gymnasium for a system, in which an agent replaces some components (the open
components).

One step of the environment sets the outputs of the open components and performs macro steps up to
the instant at which these components would read their inputs again. If the agent repeats the
outputs that the components had in a run of the system, the episode equals this run bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import EzPickle

from harness.authoring.policy import Policy
from harness.errors import RunError, UsageError
from harness.learning.scoring import Scoring, Weights
from harness.learning.spaces import Bound, Spaces, actuator_limits
from harness.master.changes import Changes, apply, joined
from harness.master.executors import Stretch
from harness.master.simulation import Simulation
from harness.mission.library import mission
from harness.mission.mission import Steering
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.ssp.library import load
from harness.studies.campaign.draft import read_plan
from harness.studies.campaign.plan import changes_of
from harness.system.graph import constants
from harness.system.model import System


class Environment(gymnasium.Env[Array, Array], EzPickle):
    """Environment of one system; harness.environment() explains the arguments."""

    def __init__(  # noqa: PLR0913 - see harness.environment()
        self,
        system: str | Path,
        *,
        open: Sequence[str] = (),
        observe: Sequence[str] = (),
        act: Sequence[str] = (),
        every: int = 0,
        reward: str = "",
        cost: str | None = None,
        weights: Weights = 1.0,
        ends: Sequence[str] | None = None,
        shield: str = "",
        bounds: Mapping[str, Bound] | None = None,
        scale: Mapping[str, float] | None = None,
        factors: str | Path | None = None,
        stride: int = 1,
        begin: int = 0,
        record: int = 0,
        **changes: Any,
    ) -> None:
        arguments = {k: x for k, x in locals().items() if k not in ("self", "changes", "__class__")}
        EzPickle.__init__(self, **arguments, **changes)
        self._plan = read_plan(factors)[0] if factors else None
        self._life = ExitStack()
        found = self._life.enter_context(load(system))
        usual = _usual(found, open)
        self._simulate(found, usual, every, record, changes)
        self._run, self._stride, self._error = begin - stride, stride, ""
        limits = bounds or {}, actuator_limits(found), dict(usual.bounds)
        self._look_up(Spaces(self.simulation, (observe, act), limits, scale))
        self._start = self.result()
        worth = reward, usual.cost if cost is None else cost, weights
        aborts, self.intervention = _shield(self._start.columns, shield)
        over = ends, (*usual.ends, *aborts)
        self.scoring = Scoring(
            self._start, self._system.requirements, worth, over, self.intervention
        )
        self._constants = self._given()

    def _look_up(self, spaces: Spaces) -> None:
        self.spaces, self._ports = spaces, spaces.ports(self.simulation)
        self.observation_names, self.action_names = spaces.observed, spaces.acted
        self.observation_space, self.action_space = spaces.observation, spaces.action

    def _simulate(
        self, found: System, usual: Steering, every: int, record: int, changes: Mapping[str, Any]
    ) -> None:
        """Create the simulation, initialise it and, if all FMUs can save their state, save the
        state for reset().

        usual: defaults of the mission; every: macro steps per action (0: default of the mission, or
        else the longest period of the open components); record: macro steps per recorded row (0:
        the value of `every`), a divisor of `every`.
        """
        given: Any = {**changes, "open": usual.open}
        self._changes: Changes = joined(self._plan.fixed, given) if self._plan else given
        self.every = every or usual.every or max(found.component(n).every for n in usual.open)
        if self.every % (record or self.every):
            raise UsageError(f"record {record}: must divide every = {self.every} macro steps")
        self._system = apply(found, **self._changes)
        self.simulation = self._life.enter_context(
            Simulation(found, every=record or self.every, **self._changes)
        )
        self.simulation.initialize()
        nodes = self.simulation.graph.nodes
        saves = all(n.interface.model.coSimulation.canGetAndSetFMUstate for n in nodes)
        self._first = self.simulation.save() if saves else None

    # ---- episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; return the first observation and further data.

        If the environment has a campaign (`factors`), the episode starts like run k of this
        campaign: k is options["run"], or else the seed, or else k of the last episode plus
        `stride` (`begin` in the first episode), all modulo the number of runs. In a vector of
        environments `stride` is their number and `begin` the index of this one, else 1 and 0.
        """
        super().reset(seed=seed)
        plan, given = self._plan, (options or {}).get("run", seed)
        self._run = self._run + self._stride if given is None else int(given)
        info: dict[str, Any] = {}
        if plan:
            self._run %= plan.runs
            drawn = plan.values(self._run)
            info = {"run": self._run, "factors": drawn}
            changes = joined(self._changes, changes_of(drawn))
            self._begin(apply(self.simulation.base, **changes))
        elif self._first:
            self.simulation.restore(self._first)
        else:
            self._begin(self._system)
        self._error = ""
        self.spent = self.values()[1]
        return self._observation(), info

    def _begin(self, system: System) -> None:
        self.simulation.begin(system)
        self.simulation.initialize()
        self._ports = self.spaces.ports(self.simulation)
        self._constants = self._given()

    def _given(self) -> list[float]:
        """Return the parts of the scoring that are constant in this episode, since they depend only
        on parameters.
        """
        return self.scoring.values.constants(x for _, x in constants(self.simulation.graph))

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Apply an action for `every` macro steps; return observation, reward, whether the episode
        was terminated, whether it reached the stop time, and further data.
        """
        try:
            self.simulation.forward(self.put(self.spaces.commands(action), self.simulation.step))
        except RunError as error:
            self._error = str(error)
        values = self.values()
        info: dict[str, Any] = {"margins": self.scoring.margins(values)}
        if self.intervention:
            info["intervention"] = values[3]
        reward, self.spent = values[0] - (values[1] - self.spent), values[1]
        lost, over = bool(values[2] or self._error), self.simulation.step >= self.simulation.steps
        if lost or over:
            info |= self.ending(values)
        return self._observation(), reward, lost, over and not lost, info

    def ending(self, values: Sequence[float]) -> dict[str, Any]:
        """Return a dict with the reasons why the episode ended (`ended`; no such key if it only
        reached the stop time), and the verdicts by requirement (`requirements`).

        values: values of Scoring in the last row.
        """
        ended = self.scoring.ended(values) + ([self._error] if self._error else [])
        found = {f.name: f for f in findings(self.result())}
        return {"requirements": found} | ({"ended": ended} if ended else {})

    def put(self, command: Array, now: int) -> int:
        """Set the outputs of the open components at macro step `now` to a command (outputs,), and
        return the macro step until which they stay constant.
        """
        for port, part in self._ports:
            port[:] = command[part]
        return min(now + self.every, self.simulation.steps)

    def failed(self, stretch: Stretch) -> bool:
        """Return whether an FMU has failed, which ends the episode; stretch: macro steps that a
        vector of environments has performed for this environment.
        """
        if stretch.stop.status:
            try:
                self.simulation.finish(stretch)
            except RunError as error:
                self._error = str(error)
        return bool(self._error)

    def values(self) -> tuple[float, ...]:
        """Return reward, cost so far, end, intervention and the further values of Scoring in the
        last recorded row. Earlier rows of the same action are not evaluated.
        """
        recorder, clock = self.simulation.recorder, self.simulation.clock
        done, every = recorder.done, recorder.every
        row, over = done // every, done == recorder.steps
        if over:
            row = -(-done // every)
        time = clock.time(done if over else row * every)
        return self.scoring.values(memoryview(recorder.table[row]), self._constants, time)

    def _observation(self) -> Array:
        return self.spaces.seen(self.simulation.bus)

    def result(self) -> Result:
        """Return the episode so far as the result of a run."""
        found = self.simulation.result(self._error)
        return replace(found, values=found.values.copy())

    def policy(self, layers: Sequence[tuple[Array, Array]], activation: str = "tanh") -> Policy:
        """Return a neural network as a policy with the inputs and outputs of the open component.

        layers: weights (outputs, inputs) and biases (outputs,) of every layer; activation: function
        of the hidden layers. Raises UsageError if there are several open components, or if the name
        of a variable is not a valid name in C.
        """
        period = self.every * (self.simulation.system.experiment.step or 0.0)
        ports = self.spaces.of_policy(self.simulation, self._start.values[0], period)
        return Policy(ports, [(np.asarray(w), np.asarray(b)) for w, b in layers], activation)

    def close(self) -> None:
        """Free the FMUs and end the simulation."""
        self._life.close()


def _shield(columns: Sequence[str], name: str) -> tuple[list[str], str]:
    """Return the variables by which a shield (safety monitor or filter) ends an episode, and the
    variable that states how much the shield changed the action ("": none).

    columns: variables of the system; name: name of the shield ("": none). Raises UsageError if the
    system has no such component.
    """
    abort, change = f"{name}.abort", f"{name}.intervention"
    if name and not {abort, change} & {*columns}:
        raise UsageError(
            f"shield {name}: the system has no such component with an output `abort` or "
            "`intervention`; systems with a filter are called NAME_filtered"
        )
    return [abort] if abort in columns else [], change if change in columns else ""


def _usual(system: System, given: Sequence[str]) -> Steering:
    """Return the default settings of the mission for an agent that replaces components.

    given: open components (empty: those that the mission suggests). Raises UsageError if none are
    given and the mission suggests none.
    """
    offered = mission(system.mission) if system.mission else None
    names = {c.name for c in system.components}
    for usual in offered.steering if offered else ():
        if {*usual.open} <= names and (not given or tuple(given) == usual.open):
            return usual
    if not given:
        raise UsageError(f"open: name the components of {system.name} that the agent replaces")
    return Steering(tuple(given))
