# SPDX-License-Identifier: BSD-2-Clause
"""NAME.csv.toml: what a bare table of numbers does not say of itself.

Units, meanings, parameters and provenance stand beside the .csv and not in it, so that a
spreadsheet or pandas reads the table without being told anything. It holds the hash of the table
that it belongs to; beside any other it counts for nothing.
"""

from __future__ import annotations

import logging
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.output import written
from harness.files.sealed import sha256
from harness.results import provenance
from harness.results.result import Result

_log = logging.getLogger("harness")


def place(csv: Path) -> Path:
    """Where the file beside a .csv is."""
    return csv.with_name(f"{csv.name}.toml")


def write(result: Result, csv: Path) -> None:
    """Write the file beside a .csv that is complete; OSError or ResultsError."""
    import tomli_w

    about = {"sha256": sha256(csv), **content(result)}
    with written(place(csv)) as path:
        path.write_text(tomli_w.dumps(about), encoding="utf-8")


def content(result: Result) -> dict[str, Any]:
    """All that is no number of the table, as TOML and JSON have it."""
    about: dict[str, Any] = {
        "system": result.system,
        "complete": result.complete,
        "message": result.message,
    }
    if result.provenance is not None:
        about["provenance"] = provenance.table(result.provenance)
    if result.parameters is not None:
        about["parameters"] = _values(result.parameters) | _texts(result.parameters)
    return {**about, "columns": _texts(result)}


def _values(parameters: Result) -> dict[str, Any]:
    return {"values": dict(zip(parameters.columns, parameters.values[0].tolist(), strict=True))}


def _texts(result: Result) -> dict[str, Any]:
    """Units and meanings by column, where there are any."""
    given = {"units": result.units, "descriptions": result.descriptions}
    return {
        kind: {name: text for name, text in zip(result.columns, texts, strict=False) if text}
        for kind, texts in given.items()
    }


def completed(result: Result, csv: Path) -> Result:
    """The result of a .csv with what stands beside it; as it is if there is nothing, or of another
    table.
    """
    try:
        about = tomllib.loads(place(csv).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return result
    except (OSError, ValueError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s)", place(csv).name, error)
        return result
    if about.get("sha256") != sha256(csv):
        _log.warning("%s: is of another %s, it is not used", place(csv).name, csv.name)
        return result
    return told(result, about)


def told(result: Result, about: dict[str, Any]) -> Result:
    """A bare table with what content() said of it; ValueError."""
    origin, parameters = _table(about, "provenance"), _table(about, "parameters")
    return replace(
        _named(result, _table(about, "columns")),
        system=about.get("system", result.system),
        parameters=_parameters(result, parameters) if parameters else None,
        provenance=provenance.from_table(origin) if origin else None,
    )


def _table(about: dict[str, Any], name: str) -> dict[str, Any]:
    """A table within a table, {} if it is not there."""
    if not isinstance(found := about.get(name, {}), dict):
        raise ValueError(f"{name}: expected a table, got {found!r:.40}")
    return found


def _named(result: Result, texts: dict[str, Any]) -> Result:
    units, descriptions = (_table(texts, kind) for kind in ("units", "descriptions"))
    return replace(
        result,
        units=tuple(units.get(name, "") for name in result.columns),
        descriptions=tuple(descriptions.get(name, "") for name in result.columns),
    )


def _parameters(result: Result, table: dict[str, Any]) -> Result:
    given = _table(table, "values")
    for name, value in given.items():
        if not isinstance(value, int | float):
            raise ValueError(f"parameter {name}: expected a number, got {value!r:.40}")
    values = np.array([list(given.values())], dtype=np.float64)
    names, unknown = tuple(given), ("",) * len(given)
    return _named(Result(result.system, result.time[:1], names, unknown, values), table)
