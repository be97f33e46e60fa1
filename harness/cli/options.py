# SPDX-License-Identifier: BSD-2-Clause
"""The options that several commands have, said once, and what the shell completes them with."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

Command = TypeVar("Command", bound=Callable[..., None])


class Format(Enum):
    """Files that figures can be written to."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


class Look(Enum):
    """What figures are drawn for."""

    SCREEN = "screen"
    PAPER = "paper"
    SERIF = "serif"


def figures_of(results: Path) -> Path:
    """Folder for the figures of a results file or dataset, beside it."""
    return results.with_name(f"{results.stem}_figures")


class Language(Enum):
    """Languages of a controller."""

    C = "c"
    PYTHON = "python"


# ---- completion


def _completed(known: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """What the shell offers for a beginning; nothing if the names cannot be found out."""

    def complete(incomplete: str) -> list[str]:
        try:
            return [name for name in known() if name.startswith(incomplete)]
        except Exception:  # a shell must never see a traceback for a key
            return []

    return complete


def _completed_by(known: Callable[[str], Iterable[str]]) -> Callable[[str], list[str]]:
    """The same for names that depend on the beginning."""
    return lambda incomplete: _completed(lambda: known(incomplete))(incomplete)


def _systems() -> Iterable[str]:
    from harness.files import paths

    return paths.systems()


def _fmus() -> Iterable[str]:
    from harness.files import paths

    return paths.fmus()


def _shown(incomplete: str) -> Iterable[str]:
    """Systems and FMUs, and the components of a system that is named."""
    from harness.ssp.library import load, of_component

    if "." not in incomplete or not (place := of_component(incomplete)):
        return [*_systems(), *_fmus()]
    with load(place[0]) as system:
        stem = incomplete.removesuffix(place[1])
        return [f"{stem}{c.name}" for c in system.components]


def _system_of(context: typer.Context) -> Any:
    from harness.ssp.library import load, of_component

    name = context.params.get("system") or ""
    place = of_component(name)
    return load(place[0] if place else name)


def _of_system(names: Callable[[Any], Iterable[str]]) -> Callable[[typer.Context, str], list[str]]:
    """Completion by names of the system that the command line gives."""

    def complete(context: typer.Context, incomplete: str) -> list[str]:
        def known() -> list[str]:
            with _system_of(context) as system:
                return list(names(system))

        return _completed(known)(incomplete)

    return complete


def _sets(system: Any) -> Iterable[str]:
    from harness.master.changes import set_names

    return set_names(system)


def _swaps(system: Any) -> Iterable[str]:
    from harness.files import paths

    return (f"{c.name}={fmu}" for c in system.components for fmu in paths.fmus())


def _places(system: Any) -> Iterable[str]:
    from harness.remote.targets import TARGETS

    return (f"{c.name}={target}" for c in system.components for target in TARGETS)


def _latencies(system: Any) -> Iterable[str]:
    return (f"{c.name}=" for c in system.components)


def _settable(system: Any) -> Iterable[str]:
    from harness.system.graph import read_interfaces
    from harness.system.names import base

    interfaces = read_interfaces(system)
    return dict.fromkeys(f"{c}.{base(v)}=" for c, i in interfaces.items() for v in i.settable())


completed_systems = _completed(_systems)


# ---- arguments and options


def seconds(text: str) -> float:
    """A time as the user types it."""
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text}: expected a number of seconds, as in 600") from None


def some_seconds(text: str) -> float:
    """A time that must be above 0."""
    if not (time := seconds(text)) > 0:
        raise typer.BadParameter(f"{text}: expected a number of seconds above 0, as in 60")
    return time


_completed_shown = _completed_by(_shown)

SystemArgument = Annotated[
    str,
    typer.Argument(
        metavar="SYSTEM",
        help="System: name, or path of an .ssp",
        autocompletion=completed_systems,
    ),
]
ShownArgument = Annotated[
    str,
    typer.Argument(
        metavar="WHAT",
        help="SYSTEM, SYSTEM.component or FMU, by name or path",
        autocompletion=_completed_shown,
    ),
]
MissionOption = Annotated[
    Path | None,
    typer.Option(
        "--mission",
        metavar="FOLDER",
        help="Use figures and claims of the mission in this folder",
    ),
]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--for",
        metavar="SYSTEM.COMPONENT",
        help="Give it the ports of this component",
        autocompletion=_completed_shown,
    ),
]
ReportArgument = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="Results; with -o also a folder of compare or a .zarr"),
]
FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="Results of `harness run`")]
FormatOption = Annotated[Format, typer.Option("--format", help="Set the format of the figures")]
StyleOption = Annotated[
    Look, typer.Option("--style", help="Set the style; paper: 3.5 or 7 in wide, 8 pt, 300 dpi")
]
FiguresOption = Annotated[
    bool, typer.Option("--figures/--no-figures", help="Draw figures, or none")
]


@dataclass(frozen=True)
class Pictures:
    """Whether and how the figures of many runs are drawn."""

    ending: FormatOption = Format.PNG
    style: StyleOption = Look.SCREEN
    figures: FiguresOption = True


RequireOption = Annotated[
    list[str] | None,
    typer.Option(
        "--require", metavar="'C.NAME >= 4 m'", help="Require this in every row, else exit status 1"
    ),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Let all requirements and rules decide on the status")
]
PatienceOption = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        parser=some_seconds,
        help="Limit one call into a third-party FMU to this time [s]",
    ),
]
ExecutorOption = Annotated[
    str | None, typer.Option(help="Step with c, python (to debug) or fused (compiled): equal bits")
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print no progress bar and no summary")
]

CHANGES: dict[str, Any] = {
    "params": Annotated[
        str | None,
        typer.Option(
            metavar="SET_OR_FILE",
            help="Use a parameter set, .toml or .ssv",
            autocompletion=_of_system(_sets),
        ),
    ],
    "set": Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="C.NAME=VALUE",
            help="Set one parameter",
            autocompletion=_of_system(_settable),
        ),
    ],
    "swap": Annotated[
        list[str] | None,
        typer.Option(
            metavar="C=FMU",
            help="Use another FMU (name or path) for component C",
            autocompletion=_of_system(_swaps),
        ),
    ],
    "map": Annotated[
        list[str] | None,
        typer.Option(
            "--map",
            metavar="THEIRS=OURS",
            help="Connect a port (or vector) of that FMU by our name",
        ),
    ],
    "on": Annotated[
        list[str] | None,
        typer.Option(
            metavar="C=PLACE",
            help="Run component C on a processor: cortex-m7, tcp://..",
            autocompletion=_of_system(_places),
        ),
    ],
    "latency": Annotated[
        list[str] | None,
        typer.Option(
            metavar="C=N",
            help="Delay the outputs of component C by N macro steps",
            autocompletion=_of_system(_latencies),
        ),
    ],
    "step": Annotated[
        float | None, typer.Option(metavar="SECONDS", parser=seconds, help="Set the macro step [s]")
    ],
    "stop": Annotated[
        float | None, typer.Option(metavar="SECONDS", parser=seconds, help="Set the stop time [s]")
    ],
    "algorithm": Annotated[
        str | None, typer.Option(help="Set the order of execution: gauss-seidel or jacobi")
    ],
    "require": RequireOption,
}
"""The options of harness.master.changes.Changes by name."""


def takes_changes(*names: str) -> Callable[[Command], Command]:
    """Give a command the named options of CHANGES; it receives those that were given as one
    dictionary, its argument `changes`.
    """

    def given(values: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if value is not None}

    return _with("changes", {n: (CHANGES[n], None) for n in names}, given)


def takes(name: str, group: type) -> Callable[[Command], Command]:
    """Give a command an option for every field of a data class; it receives an object of that
    class, its argument of this name.
    """
    hints = get_type_hints(group, include_extras=True)
    options = {field.name: (hints[field.name], field.default) for field in fields(group)}
    return _with(name, options, lambda values: group(**values))


def _with(
    argument: str, options: Mapping[str, tuple[Any, Any]], made: Callable[[dict[str, Any]], Any]
) -> Callable[[Command], Command]:
    """Give a command options (annotation and default by name) in the place of one argument."""

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def with_options(**given: Any) -> None:
            own = {name: given.pop(name) for name in options}
            command(**given, **{argument: made(own)})

        keyword = inspect.Parameter.KEYWORD_ONLY
        hints = get_type_hints(command, include_extras=True)
        expanded = [
            inspect.Parameter(name, keyword, default=default, annotation=annotation)
            for name, (annotation, default) in options.items()
        ]
        parameters: list[inspect.Parameter] = []
        for each in inspect.signature(command).parameters.values():
            own = each.replace(kind=keyword, annotation=hints[each.name])
            parameters += expanded if each.name == argument else [own]
        with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        with_options.__annotations__ = {p.name: p.annotation for p in parameters}
        return with_options  # type: ignore[return-value]

    return decorate


def size_of(path: Path) -> str:
    """Size of a file as the end of a line, nothing for a pipe or device."""
    if not path.is_file():
        return ""
    size = path.stat().st_size
    return f" ({size / 1e6:.1f} MB)" if size >= 1e5 else f" ({size / 1e3:.1f} kB)"
