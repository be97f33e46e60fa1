# SPDX-License-Identifier: BSD-2-Clause
"""Systems and FMUs for other purposes: `harness new | build | export | linearize | bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import Kind, Language, PlaceOption, SystemArgument, takes_changes
from harness.files.output import written
from harness.spelling import printable

app = typer.Typer()


@app.command("new")
def new_command(
    kind: Annotated[Kind, typer.Argument(metavar="controller", help="what to create")],
    name: Annotated[str, typer.Argument(metavar="NAME", help="its name, and that of its folder")],
    language: Annotated[Language, typer.Option(help="to write it in")] = Language.C,
    place: PlaceOption = "sync_approach.controller",
) -> None:
    """Create a controller of your own.

    A folder NAME with a source that flies as it is, and the two commands that build and fly it.
    """
    from harness.authoring.new import new_controller

    created = new_controller(name, language.value, place)
    typer.echo(printable(f"{created.source}: edit control(), then"))
    for command in created.commands:
        typer.echo(printable(f"    {command}"))


@app.command("build")
def build_command(
    name: Annotated[
        Path, typer.Argument(metavar="NAME_OR_FILE", help="folder NAME, or a .c or .py file")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="FMU (default: beside the file)")
    ] = None,
    compiler: Annotated[str, typer.Option("--cc", metavar="COMMAND", help="C compiler")] = "cc",
) -> None:
    """Build an FMU from a C or Python file."""
    from harness.authoring.build import build

    built = build(name, output, compiler)
    counts = [f"{len(built.named(c))} {c}s" for c in ("input", "output", "parameter")]
    typer.echo(printable(f"{built.path}: {', '.join(counts)}"))


@app.command("export")
@takes_changes("params", "set", "swap", "latency", "step", "stop", "algorithm")
def export_command(
    system: SystemArgument,
    target: Annotated[
        Path, typer.Argument(metavar="DIR_OR_FILE", help="folder, or file NAME.ssp or NAME.fmu")
    ],
    changes: Any = None,
) -> None:
    """Write a system as one .ssp or one .fmu.

    With all changes, and everything inside.
    """
    from harness.exports.package import export

    typer.echo(export(system, target, **changes))


@app.command("linearize")
def linearize_command(
    fmu: Annotated[str, typer.Argument(metavar="FMU", help="name of an FMU, or path of a .fmu")],
    output: Annotated[Path, typer.Option("--output", "-o", help="matrices, names and units: .npz")],
    at: Annotated[float, typer.Option(help="time of the operating point [s]")] = 0.0,
    step: Annotated[float, typer.Option(help="step of the linear model [s]")] = 0.1,
    values: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="parameter or input")
    ] = None,
) -> None:
    """Write the linear model of one FMU about an operating point."""
    from harness.api import linearize

    model = linearize(fmu, at, step, set=values or ())
    with written(output) as file:
        model.save(file)
    typer.echo(
        f"{output}: {len(model.states)} states, {len(model.inputs)} inputs, "
        f"{len(model.outputs)} outputs"
    )


@app.command()
def bench(system: SystemArgument) -> None:
    """Measure the cost of a macro step.

    Ours and other masters' side by side.
    """
    from harness.bench.bench import bench as measure

    typer.echo(measure(system))
