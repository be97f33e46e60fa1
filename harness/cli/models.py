# SPDX-License-Identifier: BSD-2-Clause
"""Commands that create components and missions of the user, and that take systems and FMUs to other
tools and processors: `harness new | build | export | linearize | processor | serve`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from harness.cli.options import (
    FmuArgument,
    SystemArgument,
    Texts,
    argument,
    command,
    option,
    output,
)
from harness.errors import UsageError
from harness.files.output import written
from harness.spelling import printable


@command("new")
def new_command(
    kind: Annotated[str, argument("KIND", "Kind: controller, sensor, plant or mission")],
    name: Annotated[
        str | None, argument("NAME", "Name of the new component or mission, and of its folder")
    ] = None,
    language: Annotated[Literal["c", "python"], option("", "Language of a component")] = "c",
    place: Annotated[
        str | None, option("--for SYSTEM.COMPONENT", "Give the new component the ports of this one")
    ] = None,
    base: Annotated[str | None, option("--from SYSTEM", "System that the mission extends")] = None,
) -> None:
    """Create a controller, a sensor, a plant or a mission of your own.

    Write a folder NAME whose content runs unchanged, and print the commands that use it.
    """
    from harness.authoring.new import KINDS, new_component, new_mission

    if kind not in (*KINDS, "mission") or name is None:
        raise UsageError(f"new {kind}: expected `harness new {'|'.join(KINDS)}|mission NAME`")
    if kind == "mission":
        folder = new_mission(name, base)
        typer.echo(printable(f"{folder}: edit system.toml and mission.py, then"))
        typer.echo(printable(f"    harness run {folder} -o {folder}.nc"))
        typer.echo(printable(f"    harness report {folder}.nc --mission {folder} -o {folder}.html"))
        return
    created = new_component(name, kind, language, place)
    typer.echo(printable(f"{created.source}: edit it, then"))
    for line in created.commands:
        typer.echo(printable(f"    {line}"))


CompilerOption = Annotated[str, option("--cc COMMAND", "C compiler")]
PlaceOfFmuOption = Annotated[
    str | None, option("--as SYSTEM.COMPONENT", "Use the FMU as this component")
]


@command("build")
def build_command(  # noqa: PLR0913, PLR0917 - one argument per option
    names: Annotated[
        list[Path],
        argument(
            "NAME_OR_FILE...",
            "Folder NAME, a .c or .py file, or a policy .npz or .onnx; with --c-api: FMU... DIR",
        ),
    ],
    output: Annotated[Path | None, output("FMU to write (default: beside the file)")] = None,
    compiler: CompilerOption = "cc",
    fmi: Annotated[int, option("--fmi", "Version of FMI: 2 or 3", min=2, max=3)] = 2,
    c_api: Annotated[
        bool, option("--c-api", "Write a C interface of FMUs that needs no FMI into the folder DIR")
    ] = False,
    place: PlaceOfFmuOption = None,
) -> None:
    """Build an FMU from C, Python or a learned policy, or write the C interface of FMUs."""
    from harness.authoring.build import build
    from harness.authoring.c_api import write_components
    from harness.system.interface import read_interface

    if c_api:
        *fmus, folder = map(str, names)
        if not fmus or output is not None:
            raise UsageError("build --c-api: expected `harness build --c-api FMU... DIR`")
        _report_c_api(write_components(fmus, Path(folder), place, compiler), Path(folder))
        return
    if len(names) > 1 or place is not None:
        raise UsageError("build: expected one NAME_OR_FILE; several FMUs and --as need --c-api")
    path = build(names[0], output, compiler, fmi)
    named = read_interface(path).named
    counts = [f"{len(named(c))} {c}s" for c in ("input", "output", "parameter")]
    typer.echo(printable(f"{path}: {', '.join(counts)}"))


def _report_c_api(names: list[str], folder: Path) -> None:
    typer.echo(printable(f"{folder}: {', '.join(names)}; compile and compare with"))
    typer.echo(printable(f"    make -C {folder} test"))


SspOption = Annotated[
    int | None, option("--ssp", "Version of SSP: 1 (default for FMUs of FMI 2.0) or 2")
]


HintsOption = Annotated[
    bool,
    option(
        "--hints", "Write step sizes of slow components, for libcosim, ecos, not for OMSimulator"
    ),
]


ScalarsOption = Annotated[
    bool,
    option("--scalars", "Write an FMU of FMI 3.0 without arrays, for tools that cannot read them"),
]


OpenOption = Annotated[
    Texts,
    option("--open COMPONENT", "Leave out a component: its outputs become inputs of the rest"),
]


FmiOption = Annotated[
    int | None, option("--fmi", "Version of FMI of NAME.fmu: 2 (default) or 3", min=2, max=3)
]


@command("export", "params", "set", "swap", "map", "on", "latency", "step", "stop", "algorithm")
def export_command(  # noqa: PLR0913 - one argument per option
    *,
    system: SystemArgument,
    target: Annotated[Path, argument("DIR_OR_FILE", "Folder, or file NAME.ssp or NAME.fmu")],
    c_api: Annotated[
        bool, option("--c", "Write the flight software as C without FMI into the folder DIR")
    ] = False,
    fmi: FmiOption = None,
    ssp: SspOption = None,
    hints: HintsOption = False,
    scalars: ScalarsOption = False,
    without: OpenOption = None,
    changes: Any,
) -> None:
    """Write a system as one .ssp or one .fmu, or its flight software as C.

    The file contains the FMUs and the parameters after all changes by options.
    """
    from harness.authoring.c_api import write_system
    from harness.authoring.export import export

    if c_api:
        if fmi or ssp or hints or without or scalars:
            raise UsageError(
                "--c: is mutually exclusive with --fmi, --ssp, --hints, --open, --scalars"
            )
        _report_c_api(write_system(system, target, **changes), target)
        return
    own: Any = {"hints": hints, "scalars": scalars, "without": without or ()}
    typer.echo(export(system, target, fmi, ssp, **own, **changes))


@command("linearize")
def linearize_command(
    fmu: FmuArgument,
    output: Annotated[Path, output("File to write: .npz with matrices, names and units")],
    at: Annotated[float, option("", "Set the time of the operating point [s]")] = 0.0,
    step: Annotated[float, option("", "Set the step of the linear model [s]")] = 0.1,
    values: Annotated[Texts, option("--set NAME=VALUE", "Set a parameter or input")] = None,
) -> None:
    """Write the linear model of one FMU about an operating point."""
    from harness.api import linearize

    if output.suffix != ".npz":
        raise UsageError(f"--output {output}: expected a file NAME.npz")
    model = linearize(fmu, at, step, set=values or ())
    with written(output) as file:
        model.save(file)
    typer.echo(
        f"{output}: {len(model.states)} states, {len(model.inputs)} inputs, "
        f"{len(model.outputs)} outputs"
    )


@command("processor")
def processor_command(
    fmus: Annotated[list[str], argument("FMU...", "FMUs: names, or paths of .fmu files")],
    on: Annotated[Texts, option("PROCESSOR", "Use this processor (default: all)")] = None,
    place: PlaceOfFmuOption = None,
    stop: Annotated[float | None, option("", "Set the stop time [s]")] = None,
    clock: Annotated[float | None, option("", "Set the clock of the processor [Hz]")] = None,
) -> None:
    """Compute the cost of FMUs on a flight processor.

    Print sizes of code, constants, data and stack, instructions per step, and whether the outputs
    equal the outputs on this machine bit by bit.
    """
    from harness.remote.firmware import PROCESSORS
    from harness.studies import processor

    rows = processor.compute_costs(
        fmus,
        on or list(PROCESSORS),
        place=place,
        stop=stop,
        clock=clock,
        notify=lambda row: typer.echo(f"{row.fmu} on {row.processor}", err=True),
    )
    typer.echo(processor.table(rows))
    if any(row.difference for row in rows):
        raise typer.Exit(1)


@command("serve")
def serve_command(
    fmu: FmuArgument,
    path: Annotated[
        Path | None, option("--socket PATH", "Listen on this Unix socket (default: a private one)")
    ] = None,
    once: Annotated[bool, option("--once", "End when the first connection closes")] = False,
) -> None:
    """Serve an FMU as a board, for `--on COMPONENT=unix:///PATH`.

    The command runs until it is interrupted and accepts connections of the same user only.
    Protocol: docs/protocol.md.
    """
    from harness.master.serve import Board, listening, serve
    from harness.system.swap import find_fmu

    file = find_fmu(fmu)
    with Board(file) as board, listening(path) as listener:
        typer.echo(f"{file.stem}: unix://{listener.getsockname()}")
        sys.stdout.flush()
        while True:
            serve(board, listener)
            if once:
                return
