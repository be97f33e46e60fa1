# SPDX-License-Identifier: BSD-2-Clause
"""Contenders of the measurement: monolithic C, bare C loop, our executors, FMPy, other masters, all
with one system in Gauss-Seidel order (other masters: their own).
"""

from __future__ import annotations

from contextlib import AbstractContextManager, ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Self

from fmpy.fmi2 import FMU2Slave

from harness.files.paths import systems
from harness.master.fmu import Instance
from harness.master.simulation import Simulation
from harness.system.model import System
from harness.system.schedule import Verb
from tests.bench.monolith import Monolith, SlaveLoop

FAST_STEPS, SLOW_STEPS = 6000, 300
"""Macro steps per round for contenders in C and in Python."""


class Contender(AbstractContextManager["Contender"]):
    """Something that can perform macro steps 0 .. steps - 1 from a fresh start."""

    steps = FAST_STEPS

    def __init__(self, system: System) -> None:
        self.system = system
        self.stack = ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stack.close()

    def run(self) -> None:
        """Perform the macro steps; only this is timed."""
        raise TypeError(f"{type(self).__name__} does not run")

    def simulation(self, executor: str = "c") -> Simulation:
        """The system loaded and initialised, long enough for one round."""
        experiment = replace(
            self.system.experiment, stop=self.system.experiment.start + self.steps * self.step
        )
        simulation = self.stack.enter_context(
            Simulation(replace(self.system, experiment=experiment), executor=executor)
        )
        simulation.initialize()
        return simulation

    @property
    def step(self) -> float:
        """Macro step [s]."""
        return self.system.experiment.step or 0.0


class MonolithicProgram(Contender):
    """The same model files in one C program, no FMI."""

    def __enter__(self) -> Self:
        self.monolith = Monolith(self.system)
        return self

    def run(self) -> None:
        self.monolith.run(self.steps)


class BareLoop(Contender):
    """A hand-written C loop over the same FMUs: set, step, get, nothing else."""

    def __enter__(self) -> Self:
        self.loop = SlaveLoop(self.simulation())
        return self

    def run(self) -> None:
        self.loop.run(self.steps)


class RecordingC(Contender):
    """Our C executor, recording every macro step."""

    executor = "c"

    def __enter__(self) -> Self:
        self.ready = self.simulation(self.executor)
        return self

    def run(self) -> None:
        self.ready.advance()


class RecordingFused(RecordingC):
    """The same loop over one FMU of the whole system: all outputs are read and recorded."""

    executor = "fused"


class RecordingPython(RecordingC):
    """Our Python executor, recording every macro step."""

    executor = "python"
    steps = SLOW_STEPS


class FMPyLoop(Contender):
    """A Python loop over the methods of FMPy's FMU2Slave with lists, as in its examples."""

    steps = SLOW_STEPS

    def __enter__(self) -> Self:
        simulation = self.simulation()
        self.bus = list(simulation.bus)
        self.plan = [
            (_slave(u), *_lists(u, Verb.SET), *_lists(u, Verb.GET)) for u in simulation.instances
        ]
        return self

    def run(self) -> None:
        for k in range(self.steps):
            for slave, inputs, sources, outputs, slots in self.plan:
                slave.setReal(inputs, [self.bus[i] for i in sources])
                slave.doStep(
                    currentCommunicationPoint=k * self.step, communicationStepSize=self.step
                )
                for slot, value in zip(slots, slave.getReal(outputs), strict=True):
                    self.bus[slot] = value


def _slave(unit: Instance) -> FMU2Slave:
    """FMPy's methods over an FMU that is loaded and initialised."""
    slave = FMU2Slave.__new__(FMU2Slave)
    slave.dll, slave.component = unit.calls.library, unit.calls.handle
    slave.fmiCallLogger, slave._functions = None, {}
    slave._loadFunctions()
    return slave


def _lists(unit: Instance, verb: Verb) -> tuple[list[int], list[int]]:
    """Value references and slots of a unit as lists."""
    transfers = unit.transfers[verb]
    return [r for t in transfers for r in t.references], [
        int(s) for t in transfers for s in t.slots
    ]


class LibcosimMaster(Contender):
    """libcosim from the .ssp file with 0 worker threads, nothing recorded."""

    def __enter__(self) -> Self:
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimLogging import CosimLogLevel, log_output_level

        log_output_level(CosimLogLevel.FATAL)
        self.execution = CosimExecution.from_ssp_file(str(_ssp_file(self.system)))
        self.execution.real_time_simulation_enabled(enabled=False)
        self.execution.step(1)  # its initialization happens in the first step
        return self

    def run(self) -> None:
        self.execution.step(self.steps)


class ObservedLibcosim(LibcosimMaster):
    """libcosim that also stores the last values of all variables, as its users do to see
    anything.
    """

    def __enter__(self) -> Self:
        from libcosimpy.CosimObserver import CosimObserver

        super().__enter__()
        self.execution.add_observer(observer=CosimObserver.create_last_value())
        return self


class EcosMaster(Contender):
    """ecos from the .ssp file, nothing recorded."""

    def __enter__(self) -> Self:
        from ecospy import EcosSimulation

        self.master = self.stack.enter_context(
            EcosSimulation(self.step, ssp_path=str(_ssp_file(self.system)))
        )
        self.master.init(parameter_set="default")
        return self

    def run(self) -> None:
        self.master.step(self.steps)


def _ssp_file(system: System) -> Path:
    """The .ssp of a system of the project."""
    return systems()[system.name]


CONTENDERS: tuple[tuple[str, type[Contender]], ...] = (
    ("monolithic C program", MonolithicProgram),
    ("bare C loop over the FMUs", BareLoop),
    ("C executor, recording", RecordingC),
    ("fused executor, recording", RecordingFused),
    ("Python executor, recording", RecordingPython),
    ("FMPy FMU2Slave methods", FMPyLoop),
    ("libcosim, 0 worker threads", LibcosimMaster),
    ("libcosim with an observer", ObservedLibcosim),
    ("ecos", EcosMaster),
)
