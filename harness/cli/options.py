# SPDX-License-Identifier: BSD-2-Clause
"""Options that several commands share, the decorator `command` that adds a command, and the shell
completion of names of systems.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer
from typer.core import TyperCommand

from harness.files import paths

Command = TypeVar("Command", bound=Callable[..., None])


def figures_of(results: Path) -> Path:
    """Return the default folder for the figures of a results file or dataset: NAME_figures beside
    it.
    """
    return results.parent / f"{results.stem}_figures"


# ---- arguments and options

Completion = Callable[[str], list[str]]


def systems(incomplete: str) -> list[str]:
    """Return the names of systems that begin with the typed text, for completion in the shell."""
    return [name for name in paths.systems() if name.startswith(incomplete)]


def argument(metavar: str, text: str, completed: Completion | None = None) -> Any:
    """Return the typer declaration of a positional argument.

    metavar: name in the help; text: help text; completed: function that returns the possible
    completions of a beginning typed in the shell.
    """
    return typer.Argument(metavar=metavar, help=text, autocompletion=completed)


def option(usage: str, text: str, **more: Any) -> Any:
    """Return the typer declaration of an option.

    usage: names and placeholder as on a command line, `--output -o FILE`; without a name the option
    is named after the parameter that it annotates; text: help text; more: settings of typer.Option.
    """
    words = usage.split(" ")
    names = [word for word in words if word.startswith("-")]
    metavar = " ".join(words[len(names) :]) or None
    return typer.Option(*names, metavar=metavar, help=text, **more)


def output(text: str) -> Any:
    """Return the typer declaration of the option `--output -o`; text: its help text."""
    return option("--output -o", text)


def seconds(text: str) -> float:
    """Return the value of an option in seconds; raise BadParameter if the text is no number."""
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text}: expected a number of seconds, as in 600") from None


def positive(text: str) -> float:
    """Return the value of an option in seconds; raise BadParameter if the text is no number
    above 0.
    """
    if not (time := seconds(text)) > 0:
        raise typer.BadParameter(f"{text}: expected a number of seconds above 0, as in 60")
    return time


Text = str | None
Texts = list[str] | None
"""Values of an option that may be given several times."""

SystemArgument = Annotated[str, argument("SYSTEM", "System: name, or path of an .ssp", systems)]
FmuArgument = Annotated[str, argument("FMU", "FMU: name, or path of a .fmu")]
MissionOption = Annotated[
    Path | None, option("--mission FOLDER", "Use figures and claims of the mission in this folder")
]
RequireOption = Annotated[
    Texts, option("--require 'C.NAME >= 4 m'", "Require this in every row, else exit status 1")
]
StrictOption = Annotated[
    bool, option("--strict", "Exit with 1 unless requirements, rules and claims (report) are met")
]
PatienceOption = Annotated[
    float | None,
    option("SECONDS", "Limit one call into a third-party FMU to this time [s]", parser=positive),
]
ExecutorOption = Annotated[
    Text, option("", "Run by c, python (for debugging) or fused (compiled): equal results")
]
QuietOption = Annotated[bool, option("--quiet -q", "Print no progress bar, notes and summary")]

CHANGES: dict[str, Any] = {
    "params": Annotated[Text, option("SET_OR_FILE", "Use a parameter set, .toml or .ssv")],
    "set": Annotated[Texts, option("C.NAME=VALUE", "Set one parameter")],
    "swap": Annotated[Texts, option("C=FMU", "Use another FMU (name or path) for component C")],
    "map": Annotated[
        Texts, option("THEIRS=OURS", "Use port THEIRS of a swapped FMU as port OURS of the system")
    ],
    "on": Annotated[
        Texts, option("C=PLACE", "Run component C on a processor: cortex-m7, tcp://..")
    ],
    "latency": Annotated[Texts, option("C=N", "Delay the outputs of component C by N macro steps")],
    "step": Annotated[float | None, option("SECONDS", "Set the macro step [s]", parser=seconds)],
    "stop": Annotated[float | None, option("SECONDS", "Set the stop time [s]", parser=seconds)],
    "algorithm": Annotated[Text, option("", "Set the order of execution: gauss-seidel or jacobi")],
    "require": RequireOption,
}
"""Options that change a system before the run. The keys are the names of the fields of
harness.master.changes.Changes.
"""


@dataclass(frozen=True)
class Drawing:
    """Format and style of figures."""

    ending: Annotated[
        Literal["png", "svg", "pdf"], option("--format", "Set the format of the figures")
    ] = "png"
    style: Annotated[
        Literal["screen", "paper", "serif"],
        option("--style", "Set the style; paper: 3.5 in (one column), 8 pt, 300 dpi"),
    ] = "screen"

    def how(self) -> tuple[str, Any]:
        """Return file ending and Style of the figures, for the functions that draw them."""
        from harness.figures.style import style_of

        return self.ending, style_of(self.style)


class OnceCommand(TyperCommand):
    """Command of typer that reports an error if an option that takes one value is repeated."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; exit with an error if an option that takes one value is repeated."""
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        for parameter in order:
            single = parameter.param_type_name == "option" and not parameter.multiple
            if single and not getattr(parameter, "is_flag", False) and order.count(parameter) > 1:
                ctx.fail(f"{parameter.opts[0]} is given twice")
        return super().parse_args(ctx, args)


app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=True)


def command(name: str, *changes: str) -> Callable[[Command], Command]:
    """Return a decorator that adds a function as a command to `app`.

    A parameter whose type is a data class becomes one option per field. changes: names of options
    of CHANGES, whose given values the function receives as the mapping `changes`.
    """

    def decorate(work: Command) -> Command:
        own = _parameters(work)

        @functools.wraps(work)
        def with_options(**given: Any) -> None:
            work(**{each.name: _taken(each, changes, given) for each in own})

        options = [option for each in own for option in _options(each, changes)]
        with_options.__signature__ = Signature(options)  # type: ignore[attr-defined]
        with_options.__annotations__ = {each.name: each.annotation for each in options}
        app.command(name, cls=OnceCommand)(with_options)
        return work

    return decorate


def _parameters(command: Any) -> list[Parameter]:
    return list(signature(command, eval_str=True).parameters.values())


def _group(parameter: Parameter) -> list[Parameter]:
    """Return the fields of the data class that is the type of a parameter; [] for other types."""
    return _parameters(parameter.annotation) if is_dataclass(parameter.annotation) else []


def _options(parameter: Parameter, changes: Sequence[str]) -> Iterator[Parameter]:
    """Yield the command-line options for one parameter of a command's function: an option for each
    name in `changes` if the parameter has the name `changes`, for each field if its type is a data
    class, otherwise one option.
    """
    if parameter.name == "changes":
        for name in changes:
            yield Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=CHANGES[name])
    elif group := _group(parameter):
        for each in group:
            yield from _options(each, changes)
    else:
        yield parameter.replace(kind=Parameter.KEYWORD_ONLY)


def _taken(parameter: Parameter, changes: Sequence[str], given: Mapping[str, Any]) -> Any:
    """Return the value that a command's function receives for one of its parameters; changes: names
    of options of CHANGES; given: values of all options by name.
    """
    if parameter.name == "changes":
        return {name: given[name] for name in changes if given[name] is not None}
    if group := _group(parameter):
        return parameter.annotation(**{p.name: _taken(p, changes, given) for p in group})
    return given[parameter.name]


def size_of(path: Path) -> str:
    """Return the size of a file as a text to end a line, " (1.2 MB)"; "" for a pipe or device."""
    if not path.is_file():
        return ""
    size = path.stat().st_size
    return f" ({size / 1e6:.1f} MB)" if size >= 1e5 else f" ({size / 1e3:.1f} kB)"
