# SPDX-License-Identifier: BSD-2-Clause
"""Pages of the commands of `harness`, one each, from the command line itself."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from typing import Any

from text import table

from harness.cli.app import group


def commands() -> Mapping[str, Any]:
    """Return the commands by name, as the click objects that typer builds."""
    return dict(sorted(group().commands.items()))


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and text of the pages of the commands."""
    known = commands()
    rows = [(f"[`harness {name}`]({name}.md)", summary(c)) for name, c in known.items()]
    yield "reference/commands/index.md", HEAD + table(("Command", "Purpose"), rows) + TAIL
    for name, command in known.items():
        yield f"reference/commands/{name}.md", page(name, command)


HEAD = """# Command line

Every command takes `--help`. An error is one line or more on standard error, each
with `harness:` in front.

| Exit status | Meaning |
|---|---|
| 0 | Success |
| 1 | The run or the check failed |
| 2 | The command line is wrong |

"""
TAIL = """
## Environment variables

| Variable | Meaning |
|---|---|
| `HARNESS_CACHE` | Folder of the cache, or `off` |
| `HARNESS_TRACEBACK` | 1: show the Python traceback of an internal error |
| `SERVICING_FMUS_BUILD` | Build folder to use instead of the FMUs and systems of the package |
| `NO_COLOR` | Set: print verdicts without colour |
| `SOURCE_DATE_EPOCH` | Date that files contain [s since 1970], for equal bytes of a repeated run |
"""


def summary(command: Any) -> str:
    """Return the first paragraph of the help of a command."""
    return inspect.cleandoc(command.help or "").partition("\n\n")[0]


def page(name: str, command: Any) -> str:
    """Return the page of one command."""
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option"]
    usage = " ".join(["harness", name, "[OPTIONS]", *map(shown, arguments)])
    parts = [f"# harness {name}\n", inspect.cleandoc(command.help or "") + "\n"]
    parts.append(f"```\n{usage}\n```\n")
    if arguments:
        rows = [(f"`{shown(p)}`", p.help or "") for p in arguments]
        parts.append("## Arguments\n\n" + table(("Argument", "Meaning"), rows))
    rows = [(f"`{'`, `'.join(names(p))}`", metavar(p), p.help or "", default(p)) for p in options]
    if rows:
        parts.append("## Options\n\n" + table(("Option", "Value", "Meaning", "Default"), rows))
    return "\n".join(parts)


def shown(argument: Any) -> str:
    """Return the placeholder of an argument."""
    return str(argument.metavar or argument.name.upper())


def names(option: Any) -> list[str]:
    """Return all spellings of an option."""
    return [*option.opts, *option.secondary_opts]


def metavar(option: Any) -> str:
    """Return the choices or the placeholder of the value of an option, empty for a flag."""
    if option.is_flag:
        return ""
    if choices := getattr(option.type, "choices", None):
        return ", ".join(f"`{choice}`" for choice in choices)
    return f"`{option.metavar or option.type.name.upper()}`"


def default(option: Any) -> str:
    """Return the default value, empty if there is none."""
    value = option.default
    if value is None or value is False or value == () or callable(value):
        return ""
    return f"`{getattr(value, 'value', value)}`"
