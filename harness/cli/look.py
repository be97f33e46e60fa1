# SPDX-License-Identifier: BSD-2-Clause
"""Commands that show and check systems, FMUs and results:
`harness list | docs | show | requirements | check | draw | plan | plot | report | convert |
validate`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    CHANGES,
    Drawing,
    MissionOption,
    RequireOption,
    StrictOption,
    SystemArgument,
    argument,
    command,
    figures_of,
    option,
    output,
    size_of,
)
from harness.errors import UsageError
from harness.files import cache, paths
from harness.files.checksums import sha256
from harness.spelling import file_stem, pieces, printable


@command("list")
def list_command(
    system: Annotated[str | None, argument("[SYSTEM]", "System: name, or path of an .ssp")] = None,
) -> None:
    """Show systems, parameter sets and FMUs."""
    typer.echo(printable(_listed(system)))


def _listed(system: str | None) -> str:
    """Return the text of `harness list` for one system, or for all systems and FMUs (None). The
    text for all is cached until one of their files changes.
    """

    def compute() -> str:
        from harness.cli import showing

        return showing.listed(system)

    if system is not None:
        return compute()
    files = (*paths.systems().values(), *paths.fmus().values())
    key = "".join(f"{path} {sha256(path)}\n" for path in files).encode()
    return cache.computed("list", key, compute)


@command("docs")
def docs_command(
    where: Annotated[
        bool, option("--where", "Print the path of the first page instead of opening it")
    ] = False,
) -> None:
    """Open the documentation of this version in a browser.

    The package contains the pages; no network is needed.
    """
    page = paths.site()
    if page is None:
        raise UsageError("this installation has no documentation pages; `make site` builds them")
    typer.echo(str(page))
    if not where:
        import webbrowser

        webbrowser.open(page.as_uri())


@command("show", "params", "set", "swap", "map", "step")
def show_command(
    *,
    system: Annotated[str, argument("WHAT", "SYSTEM, SYSTEM.component or FMU, by name or path")],
    word: Annotated[
        str | None, argument("[WORD]", "Show only rows with this word in name or description")
    ] = None,
    changed: Annotated[
        bool, option("--changed", "Show only values that --params, --set or --swap changes")
    ] = False,
    diff: Annotated[
        str | None, option("SET1,SET2", "Show only values that differ between two parameter sets")
    ] = None,
    changes: Any,
) -> None:
    """Show ports and parameters.

    SYSTEM: list the components. SYSTEM.component: list inputs, outputs and parameters with their
    values in the system. FMU: list inputs, outputs and parameters with their default values.
    """
    from harness.cli import showing
    from harness.studies.show import differences, show

    if diff is None and not changed:
        typer.echo(showing.text(show(system, word, **changes)))
        return
    first, comma, second = (diff or "").partition(",")
    if diff is not None and (changed or "params" in changes or not (first and comma and second)):
        raise UsageError(
            f"--diff {diff}: expected SET1,SET2, without --changed and --params; "
            "the set `default` has the values of the system itself"
        )
    if diff is None:
        both: tuple[Any, Any] = {}, changes
        heads = "system", "changed"
    else:
        both = {**changes, "params": first}, {**changes, "params": second}
        heads = first, second
    found = differences(system, word, before=both[0], after=both[1])
    typer.echo(showing.text(found, heads))


@command("check", *CHANGES)
def check_command(
    *,
    system: Annotated[
        str | None, argument("[SYSTEM_OR_FMU]", "System or FMU: name, or path of a file or folder")
    ] = None,
    strict: Annotated[bool, option("--strict", "Treat warnings as errors")] = False,
    changes: Any,
) -> None:
    """Report every mistake of a system or an FMU.

    An error prevents a run (exit status 1). A warning does not, such as a deviation from the
    standard. Options such as --set change the system before the check. Without a name the command
    lists the flight processors of --on, each with `ready` or the tools that this machine lacks.
    """
    from harness.studies import check as study

    if system is None:
        if changes or strict:
            raise UsageError("check: give the name or path of a system or FMU before the options")
        typer.echo("\n".join(study.machine()))
        return
    verdict = study.check(system, strict, **changes)
    for warning in verdict.warnings:
        typer.echo(printable(f"harness: warning: {warning}"), err=True)
    typer.echo(printable(str(verdict)))


@command("requirements")
def requirements_command(system: SystemArgument) -> None:
    """List the requirements of a system."""
    from harness.ssp.library import load

    with load(system) as found:
        for name, text in found.requirements.items():
            typer.echo(printable(f"{name} = {text!r}"))


DiagramOption = Annotated[
    Path | None, output("File to write: .svg, .pdf or .png (default: SYSTEM.svg)")
]


@command("draw", "swap")
def draw_command(*, system: SystemArgument, output: DiagramOption = None, changes: Any) -> None:
    """Draw the N2 diagram of a system: components on the diagonal, signals between them."""
    from harness.figures.diagram import draw
    from harness.master.changes import apply
    from harness.master.remainder import rest
    from harness.ssp.library import load

    with load(system) as found:
        path = output or Path(f"{file_stem(found.name)}.svg")
        draw(rest(apply(found, **changes)), path)
    typer.echo(path)


PlanFolderOption = Annotated[
    Path | None, output("Folder for the figures (default: results/SYSTEM_plan)")
]


@command("plan", "params", "set", "swap", "map", "step", "stop")
def plan_command(
    *, system: SystemArgument, output: PlanFolderOption = None, drawing: Drawing, changes: Any
) -> None:
    """Show the plan of a mission without running the system.

    Print the plan as a table and draw it. The exit status is 1 if the plan is not feasible.
    """
    from harness.figures.plots import overlay
    from harness.studies.show import plan

    found = plan(system, **changes)
    typer.echo(found.text())
    folder = output or Path("results") / f"{Path(system).stem}_plan"
    for path in overlay(found.histories, folder, *drawing.how()):
        typer.echo(path)
    if not found.good:
        raise typer.Exit(1)


def _use(mission: Path | None) -> None:
    """Use the mission in the given folder for every result, instead of the mission that the result
    names; None: change nothing.
    """
    if mission is not None:
        from harness.mission.library import use

        use(mission, always=True)


@command("plot")
def plot_command(
    *,
    file: Annotated[Path, argument("FILE", "Results of `harness run` or `harness campaign`")],
    output: Annotated[Path | None, output("Folder for the figures (default: FILE_figures)")] = None,
    variables: Annotated[
        str | None, option("--var C.NAME,..", "Draw one figure of these variables")
    ] = None,
    drawing: Drawing,
    mission: MissionOption = None,
) -> None:
    """Draw the figures of a run or a campaign.

    For a run: the figures of its mission, or with --var one figure of any variables.
    """
    from harness.figures.plots import plot as draw
    from harness.report.campaign import pictures
    from harness.results.files import read

    names = list(filter(None, pieces(variables or "")))
    _use(mission)
    ending, style = drawing.how()
    if paths.is_folder(file):
        if names:
            raise UsageError(f"--var: {file} is a dataset; give the results file of a run")
        drawn = pictures(file, output or figures_of(file), ending, style)
    else:
        drawn = draw(read(file), output or figures_of(file), ending, style, names)
    for path in drawn:
        typer.echo(path)


@command("report")
def report_command(  # noqa: PLR0913, PLR0917 - options
    file: Annotated[
        Path, argument("FILE", "Results of a run; with -o also folder of a comparison, or .zarr")
    ],
    output: Annotated[Path | None, output("Write an HTML page with plots and a replay")] = None,
    live: Annotated[
        bool, option("--live", "Include the system: sliders change it and run it in the browser")
    ] = False,
    lesson: Annotated[
        Path | None, option("FILE.toml", "Put exercises beside the sliders of a live page")
    ] = None,
    require: RequireOption = None,
    strict: StrictOption = False,
    mission: MissionOption = None,
) -> None:
    """Evaluate a run by its requirements and the claims of its paper.

    With -o: write one page for any browser about a run, a comparison or a campaign.
    """
    from harness.cli.verdicts import insist, show
    from harness.results.files import read
    from harness.results.requirements import demanding

    wanted = require or []
    _use(mission)
    if (live or lesson) and (output is None or paths.is_folder(file)):
        raise UsageError("a live page needs the results file of one run, and -o PAGE.html")
    if paths.is_folder(file):
        if output is None or wanted or strict:
            page = f"harness report {file} -o {file.stem}.html"
            raise UsageError(f"{file}: of a campaign or comparison only a page is made: {page}")
        _page(file, output)
        return
    result = demanding(read(file), {text: text for text in wanted})
    if output is not None:
        _page(result, output, live, lesson)
    else:
        show(result)
    insist({"": result}, wanted, strict, claims=strict or output is None)
    if output is None and not result.complete:
        raise typer.Exit(1)


def _page(source: Any, output: Path, live: bool = False, lesson: Path | None = None) -> None:
    from harness.api import write_page

    typer.echo(write_page(source, output, live, lesson))


@command("convert")
def convert_command(
    file: Annotated[Path, argument("FILE", "Results of `harness run`")],
    output: Annotated[Path, output("File to write: .nc, .csv; of bodies .oem, .aem, .czml")],
    body: Annotated[
        str | None, option("COMPONENT", "Write only this body (default: the first; .czml: all)")
    ] = None,
    epoch: Annotated[
        str | None, option("DATE", "Set the UTC of t = 0 (default: from the run, or J2000)")
    ] = None,
) -> None:
    """Write a result into a file of another kind.

    In CCSDS ephemerides (.oem, .aem) and CZML, the inertial frame N is EME2000 about the Earth.
    """
    from harness.mission.exchange import convert

    path = convert(file, output, body, epoch)
    typer.echo(f"{path}{size_of(path)}")


@command("validate")
def validate_command(
    names: Annotated[list[str] | None, argument("[CASE]...", "Cases to run (default: all)")] = None,
) -> None:
    """Compare the FMUs with published reference values."""
    from harness.claims.case import table, validate

    rows = validate(names or None)
    typer.echo(table(rows))
    if not all(row.within for row in rows):
        raise typer.Exit(1)
