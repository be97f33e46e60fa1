# SPDX-License-Identifier: BSD-2-Clause
"""A system as an environment of Gymnasium: an agent in the place of some components.

One step of the environment sets the outputs of these components and performs macro steps up to the
instant at which the components would read their inputs again. An episode under the actions that a
component has recorded is the run of the system, bit for bit.
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

from harness.authoring.policy import Policy, Ports
from harness.errors import RunError, UsageError
from harness.figures.picture import picture
from harness.learning import rows, signals
from harness.learning.signals import FAR, Bound, Limits
from harness.master.changes import Changes, apply, joined
from harness.master.executors import Stretch
from harness.master.simulation import Simulation
from harness.mission.library import mission, of_result
from harness.mission.mission import Steering
from harness.report.arrays import Arrays
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.ssp.library import load
from harness.studies.campaign.draft import read_plan
from harness.studies.campaign.plan import changes_of
from harness.system.model import System
from harness.system.values import base


class Environment(gymnasium.Env[Array, Array], EzPickle):
    """Environment of one system, see harness.environment()."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

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
        weights: Mapping[str, float] | float = 1.0,
        ends: Sequence[str] | None = None,
        shield: str = "",
        bounds: Mapping[str, Bound] | None = None,
        scale: Mapping[str, float] | None = None,
        factors: str | Path | None = None,
        stride: int = 1,
        record: int = 0,
        render_mode: str | None = None,
        **changes: Any,
    ) -> None:
        EzPickle.__init__(
            self, system, open=open, observe=observe, act=act, every=every, reward=reward,
            cost=cost, weights=weights, ends=ends, shield=shield, bounds=bounds, scale=scale,
            factors=factors, stride=stride, record=record, render_mode=render_mode, **changes,
        )  # fmt: skip
        self.render_mode = render_mode
        self._plan = read_plan(factors)[0] if factors else None
        self._life = ExitStack()
        found = self._life.enter_context(load(system))
        usual = _usual(found, open)
        self._simulate(found, usual, every, record, changes)
        self._run, self._stride, self._error = -stride, stride, ""
        self._spaces(
            observe, act, (bounds or {}, signals.actuator_limits(found), dict(usual.bounds)), scale
        )
        self._rewards(self._system, reward, usual.cost if cost is None else cost, weights)
        self._ends_of(ends, usual.ends, shield)

    def _simulate(
        self, found: System, usual: Steering, every: int, record: int, changes: Mapping[str, Any]
    ) -> None:
        """Prepare the simulation and save its start, to which a reset returns."""
        given: Any = {**changes, "open": usual.open}
        self._changes: Changes = joined(self._plan.fixed, given) if self._plan else given
        self.every = every or usual.every or max(found.component(n).every for n in usual.open)
        if self.every % (record or self.every):
            raise UsageError(f"record {record}: must divide every, {self.every} macro steps")
        self._system = apply(found, **self._changes)
        self.simulation = self._life.enter_context(
            Simulation(found, every=record or self.every, **self._changes)
        )
        self.simulation.initialize()
        nodes = self.simulation.graph.nodes
        saves = all(n.interface.model.coSimulation.canGetAndSetFMUstate for n in nodes)
        self._first = self.simulation.save() if saves else None

    # ---- spaces

    def _spaces(
        self,
        observe: Sequence[str],
        act: Sequence[str],
        limits: Limits,
        scale: Mapping[str, float] | None,
    ) -> None:
        seen, acted = (
            signals.observed(self.simulation, observe),
            signals.acted(self.simulation, act, limits),
        )
        self.observation_names = [f"{s.name} [{s.unit}]" for s in seen]
        self.action_names = [f"{s.name} [{s.unit}]" for s in acted]
        sizes = np.array([dict(scale or {}).get(base(s.name), 1.0) for s in seen])
        self._sizes = sizes
        self._slots = np.array([s.wire.slot for s in seen], dtype=np.intp)
        self._factors = np.array([s.wire.change.factor for s in seen]) / sizes
        self._offsets = np.array([s.wire.change.offset for s in seen]) / sizes
        low, high = np.array([(s.low, s.high) for s in seen]).reshape(-1, 2).T / sizes
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float64)
        self._low, self._high = np.array([(s.low, s.high) for s in acted]).T
        one = np.ones(len(acted))
        self._ends = (-one, one) if scale is not None else (self._low, self._high)
        self.action_space = gymnasium.spaces.Box(*self._ends, dtype=np.float64)
        self._scaled = scale is not None
        names = list(dict.fromkeys(base(s.name) for s in acted))
        ports = [self.simulation.port(name).reshape(-1) for name in names]
        last = np.cumsum([port.size for port in ports]).tolist()
        self._ports = [(p, slice(n - p.size, n)) for p, n in zip(ports, last, strict=True)]

    # ---- rewards and ends

    def _rewards(
        self, system: System, reward: str, cost: str, weights: Mapping[str, float] | float
    ) -> None:
        self._kinds = self.result()
        found = {n: rows.margin(self._kinds, t) for n, t in system.requirements.items()}
        self._margins = {name: row for name, row in found.items() if row is not None}
        given = weights if isinstance(weights, Mapping) else dict.fromkeys(self._margins, weights)
        self._weights = [(name, w) for name in self._margins if (w := given.get(name, 0.0))]
        self._reward, self._cost = (self._row(text or "0") for text in (reward, cost))

    def _row(self, text: str) -> rows.Row:
        try:
            found = rows.value(self._kinds, text)
        except (ValueError, KeyError) as error:
            raise UsageError(f"{text}: {error.args[0]}") from error
        if found is None:
            raise UsageError(f"{text}: depends on other rows than the present one")
        return found

    def _ends_of(self, ends: Sequence[str] | None, usual: Sequence[str], shield: str) -> None:
        """Note what ends an episode: requirements, conditions, and the abort of a shield."""
        given = [*usual, *(self._margins if ends is None else ends)]
        self._shield = -1
        columns = self._kinds.columns
        if shield:
            if not {f"{shield}.abort", f"{shield}.intervention"} & {*columns}:
                raise UsageError(
                    f"shield {shield}: {self._kinds.system} has no such component that aborts or "
                    "intervenes; systems with a filter are called NAME_filtered"
                )
            given += [f"{shield}.abort"] if f"{shield}.abort" in columns else []
            if f"{shield}.intervention" in columns:
                self._shield = columns.index(f"{shield}.intervention")
        self._lost = [name for name in given if name in self._margins]
        self._over = {text: self._row(text) for text in given if text not in self._margins}

    # ---- episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode; with `factors` run k of the campaign: options {"run": k}, or the seed,
        or the run after the last one.
        """
        super().reset(seed=seed)
        plan, given = self._plan, (options or {}).get("run", seed)
        self._run = self._run + self._stride if given is None else int(given)
        simulation, info = self.simulation, {}
        if plan is None and self._first:
            simulation.restore(self._first)
        elif plan is None:
            simulation.begin(self._system)
            simulation.initialize()
        else:
            self._run %= plan.runs
            drawn = plan.values(self._run)
            info = {"run": self._run, "factors": drawn}
            changes = joined(self._changes, changes_of(drawn))
            simulation.begin(apply(simulation.base, **changes))
            simulation.initialize()
        self._error = ""
        self._spent = self._cost(*self._now())
        return self._observation(), info

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for `every` macro steps."""
        try:
            self.simulation.forward(self.act(action))
        except RunError as error:
            self._error = str(error)
        return self.outcome()

    def finish(self, stretch: Stretch) -> None:
        """Note how far the macro steps of a vector came; an FMU that fails ends the episode."""
        try:
            self.simulation.finish(stretch)
        except RunError as error:
            self._error = str(error)

    def act(self, action: Array) -> int:
        """Set the outputs of the open components and return the macro step to which they are
        held.
        """
        action = np.asarray(action, dtype=np.float64)
        if self._scaled:
            action = self._low + 0.5 * (action + 1.0) * (self._high - self._low)
        for port, part in self._ports:
            port[:] = action[part]
        return min(self.simulation.step + self.every, self.simulation.steps)

    def outcome(self) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Return observation, reward, whether the episode has ended by itself or at the stop time,
        and the margins of the requirements.
        """
        b, t = self._now()
        margins = {name: row(b, t) for name, row in self._margins.items()}
        info: dict[str, Any] = {"margins": margins}
        if self._shield >= 0:
            info["intervention"] = b[self._shield]
        spent = self._cost(b, t)
        reward = self._reward(b, t) - (spent - self._spent)
        reward -= sum(w * -m for name, w in self._weights if (m := max(margins[name], -FAR)) < 0)
        self._spent = spent
        ended = [name for name in self._lost if margins[name] < 0]
        ended += [text for text, row in self._over.items() if row(b, t)]
        ended += [self._error] if self._error else []
        over = self.simulation.step >= self.simulation.steps
        if ended:
            info["ended"] = ended
        if ended or over:
            info["requirements"] = {f.name: f for f in findings(self.result())}
        return self._observation(), reward, bool(ended), over and not ended, info

    def _now(self) -> tuple[Any, float]:
        """Return the last recorded row and its time: what is evaluated is what is recorded."""
        recorder, clock = self.simulation.recorder, self.simulation.clock
        done, every = recorder.done, recorder.every
        row, over = done // every, done == recorder.steps
        if over:
            row = -(-done // every)
        time = clock.time(done if over else row * every)
        return memoryview(recorder.table[row]), time

    def _observation(self) -> Array:
        seen: Array = self.simulation.bus[self._slots] * self._factors + self._offsets
        return seen

    def render(self) -> Any:
        """Return a picture (height, width, 3) of the bodies and their paths so far."""
        if self.render_mode is None:
            return None
        result, arrays = self.result(), Arrays()
        for scene in of_result(result).scene:
            if result.holds(*scene.needs, parameters=scene.parameters):
                title = f"{self.simulation.time:.6g} s"
                return picture(scene.build(result, arrays), arrays.take, title)
        raise UsageError(f"{result.system}: its mission has no replay to render")

    def shown(self, name: str) -> Any:
        """Return an attribute, for an environment in another process."""
        return getattr(self, name)

    def result(self) -> Result:
        """Return the episode so far as the result of a run."""
        found = self.simulation.result(self._error)
        return replace(found, values=found.values.copy())

    def policy(self, layers: Sequence[tuple[Array, Array]], activation: str = "tanh") -> Policy:
        """Return a network as a policy with the ports of the open component, see Policy. Raises
        UsageError with several open components, or for a name that is none in C.
        """
        opened, nodes = self.simulation.system.without, self.simulation.graph.nodes
        if len(opened) > 1:
            raise UsageError(f"a policy takes the place of one component, not of {len(opened)}")
        seen, acted = (_ports(names) for names in (self.observation_names, self.action_names))
        read = {wire.slot for node in nodes for wire in node.inputs}
        commanded = {name for name, _, _ in acted}
        starts: dict[str, tuple[str, str, list[float]]] = {}
        for wire in next(n for n in nodes if n.component.name == opened[0]).outputs:
            name = base(wire.variable.name)
            if wire.slot in read or name in commanded:
                value = float(self._kinds.values[0, wire.slot])
                starts.setdefault(name, (name, wire.variable.unit or "1", []))[2].append(value)
        period = self.every * (self.simulation.system.experiment.step or 0.0)
        bounds = self._low.tolist(), self._high.tolist()
        sizes, given = self._sizes.tolist(), [*starts.values()]
        ports = Ports(seen, acted, sizes, *bounds, self._scaled, given, period)
        return Policy(ports, [(np.asarray(w), np.asarray(b)) for w, b in layers], activation)

    def close(self) -> None:
        """Free the FMUs."""
        self._life.close()


def _ports(names: Sequence[str]) -> list[tuple[str, str, int]]:
    """Return variables with their units and numbers of elements, without their components."""
    found: dict[str, tuple[str, str, int]] = {}
    for text in names:
        name, _, unit = text.rpartition(" ")
        variable = base(name).partition(".")[2]
        if not variable.isidentifier() or found.get(variable, (name,))[0] not in (name, variable):
            raise UsageError(f"{name}: cannot be a port of a policy, which is written in C")
        count = found.get(variable, ("", "", 0))[2] + 1
        found[variable] = variable, unit.strip("[]"), count
    return list(found.values())


def _usual(system: System, given: Sequence[str]) -> Steering:
    """Return the defaults of the mission for these components; raise UsageError if it has none."""
    offered = mission(system.mission) if system.mission else None
    names = {c.name for c in system.components}
    for usual in offered.steering if offered else ():
        if {*usual.open} <= names and (not given or tuple(given) == usual.open):
            return usual
    if not given:
        raise UsageError(f"open: name the components of {system.name} that the agent replaces")
    return Steering(tuple(given))
