# SPDX-License-Identifier: BSD-2-Clause
"""TOML files of systems, each merged over the file that it `extends`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.errors import StructureError
from harness.mission.library import FILE, SYSTEM, systems, systems_in
from harness.spelling import did_you_mean
from harness.system.tables import read_toml


def extended(source: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the content of the TOML file of a system, merged over the system that it `extends`.

    Its entry `mission` is the folder's name, or the mission of the extended system if the folder
    has no Python file of a mission. above: the files that extend this file, to detect a file that
    extends itself.
    """
    table = _read(source)
    mission = folder = source.resolve().parent.name
    if (base := table.get("extends")) is not None:
        path = _base(source, str(base))
        if path.resolve() in (chain := (*above, source.resolve())):
            raise StructureError([f"extends: {base} extends this system itself"])
        under = extended(path, chain)
        if not source.with_name(FILE).is_file():
            mission = under["mission"]
        table = _over(_undriven(under, table), _without(under, table))
    table.setdefault("name", folder if source.name == SYSTEM else f"{folder}_{source.stem}")
    return table | {"mission": mission}


def chain(source: Path) -> Iterator[Path]:
    """Yield the path of a TOML file, of the file that it extends, and so on."""
    yield source
    if (base := read_toml(source).get("extends")) is not None:
        yield from chain(_base(source, str(base)))


def _read(source: Path) -> dict[str, Any]:
    """Return the content of a TOML file, with the paths in `[start]` made absolute. The entry
    `attitude` is not a path, and a text of several lines is the content of a file.
    """
    table = read_toml(source)
    files: Any = table.get("start")
    for name, text in files.items() if isinstance(files, dict) else ():
        if name != "attitude" and isinstance(text, str) and "\n" not in text.strip():
            files[name] = str(source.resolve().parent / text)
    return table


def _without(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table `own` with a list `without`, the components to leave out: components that
    `own` sets to false, and components that `base` leaves out and `own` does not define again.
    """
    given = own.get("components")
    given = given if isinstance(given, dict) else {}
    out = [name for name, fmu in given.items() if fmu is False]
    if unknown := [name for name in out if name not in base["components"]]:
        close = did_you_mean(unknown[0], base["components"])
        raise StructureError(
            [f"components.{unknown[0]}: not in the extended system, nothing to leave out{close}"]
        )
    before = [name for name in base.get("without", ()) if name not in given]
    fmus = {name: base["components"][name] if name in out else fmu for name, fmu in given.items()}
    return {**own, **({"components": fmus} if fmus else {}), "without": [*before, *out]}


def _undriven(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables `base` of the extended system without its name, and without its
    open inputs to which the extending file, with the tables `own`, connects an output.
    """
    opened, driven = base.get("open"), own.get("connections")
    rest = {k: v for k, v in base.items() if k != "name"}
    if isinstance(opened, Mapping) and isinstance(driven, Mapping):
        rest["open"] = {name: value for name, value in opened.items() if name not in driven}
    return rest


def _base(source: Path, name: str) -> Path:
    """Return the TOML file of the system `name` that `source` extends: a file in its folder, else a
    mission beside this folder, else an available mission.
    """
    folder = source.resolve().parent
    known = dict(systems())
    for mission in (*(path.parent for path in folder.parent.glob(f"*/{SYSTEM}")), folder):
        known |= systems_in(mission)
    known |= {path.stem: path for path in sorted(folder.glob("*.toml"))}
    if name not in known:
        raise StructureError([f"extends: there is no system {name}{did_you_mean(name, known)}"])
    return known[name]


def _over(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table `own` merged over the table `base`, including nested tables. If `own` names
    all entries of `base`, the order of `own` applies. A file can thus insert a component between
    two others, because components run in the order of their table.
    """
    merged = dict.fromkeys(own) | dict(base) if set(base) <= set(own) else dict(base)
    for key, value in own.items():
        under = base.get(key)
        both = isinstance(under, Mapping) and isinstance(value, Mapping)
        merged[key] = _over(under, value) if both else value  # type: ignore[arg-type]
    return merged
