# SPDX-License-Identifier: BSD-2-Clause
"""Parquet format: flat columns with their units; everything else is in the metadata of the file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.errors import library
from harness.results.formats import check_size, completed, content, numbers
from harness.results.result import Result

ABOUT = b"servicing-fmus"
"""Key in the metadata of a .parquet under which everything that is not a column is stored."""


def write(result: Result, path: Path) -> None:
    """Write the file; units and descriptions are in the metadata of the columns."""
    arrow, parquet = library("pyarrow", "exchange"), library("pyarrow.parquet", "exchange")
    fields = [arrow.field("time", arrow.float64(), metadata={"units": "s"})]
    descriptions = result.descriptions or ("",) * len(result.columns)
    for name, unit, text in zip(result.columns, result.units, descriptions, strict=True):
        about = {"units": unit, "long_name": text}
        fields.append(arrow.field(name, arrow.float64(), metadata=about))
    schema = arrow.schema(fields, metadata={ABOUT: json.dumps(content(result)).encode()})
    columns = [arrow.array(column) for column in (result.time, *result.values.T)]
    parquet.write_table(arrow.table(columns, schema=schema), path, compression="zstd")


def read(path: Path) -> Result:
    """Read the file; raise ValueError if its first column is not named time."""
    parquet = library("pyarrow.parquet", "exchange")
    with path.open("rb") as file:
        about = parquet.read_metadata(file)
        check_size(8 * about.num_rows * about.num_columns)
        table = parquet.read_table(file)
    names = tuple(table.column_names)
    if names[:1] != ("time",):
        raise ValueError("the first column must be named time")
    values = np.column_stack([numbers(n, table.column(i)) for i, n in enumerate(names)])
    units = ("",) * (len(names) - 1)
    result = Result(path.stem, values[:, 0], names[1:], units, np.ascontiguousarray(values[:, 1:]))
    return _completed(result, (table.schema.metadata or {}).get(ABOUT, b"null"))


def _completed(result: Result, text: bytes) -> Result:
    """Return the result completed by the metadata of its file, unchanged if another tool wrote the
    file.
    """
    about = json.loads(text)
    if about is None:
        return result
    if not isinstance(about, dict):
        raise ValueError("the metadata of the key servicing-fmus are not a JSON table")
    complete, message = about.get("complete", True), about.get("message", "")
    return replace(completed(result, about), complete=complete, message=message)
