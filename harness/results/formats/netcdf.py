# SPDX-License-Identifier: BSD-2-Clause
"""netCDF4 format: variables with axes, units and long names; parameters are variables without time,
provenance is in attributes.
"""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path
from typing import Any

import numpy as np

from harness.results.formats import check_nul, check_size, numbers, restored
from harness.results.result import PROVENANCE, Array, Result, attributes, labelled, time_labels

PACKED = 1000
"""Number of values above which a variable is compressed, without loss."""


def fits(name: str) -> bool:
    """Return whether a netCDF file can store a name unchanged. The library would change a name that
    is not in Unicode's composed form NFC.
    """
    as_it_is = unicodedata.is_normalized("NFC", name) and len(name) <= 200
    return as_it_is and _NAME.fullmatch(name) is not None


_NAME = re.compile(r"((?a:\w)|[^\x00-\x7f])[^/\x00-\x1f\x7f]*(?<! )")
"""Regular expression of the names that netCDF accepts."""


def write(result: Result, path: Path) -> None:
    """Write the file. All variables are defined before the first is filled, because each switch
    between defining and filling costs as much as all variables so far.
    """
    import netCDF4

    check_nul(result)
    content = labelled(result)
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts(attributes(result))
        content["time"] = (("time",), result.time, time_labels(result))
        defined = [(_defined(file, name, *each), each[1]) for name, each in content.items()]
        file.set_auto_maskandscale(False)  # no search for scales, a third of the time
        for variable, data in defined:
            variable[...] = data


def _defined(
    file: Any, name: str, axes: tuple[str, ...], data: Array, about: dict[str, str]
) -> Any:
    """Return a new variable of a netCDF file with its dimensions and attributes."""
    for axis, size in zip(axes, data.shape, strict=True):
        if axis not in file.dimensions:
            file.createDimension(axis, size)
    packed = {"zlib": True, "complevel": 1, "shuffle": True} if data.size > PACKED else {}
    variable = file.createVariable(name, "f8", axes, fill_value=False, **packed)
    variable.setncatts(about)
    return variable


def read(path: Path) -> Result:
    """Read the file; a variable without a time axis is a parameter."""
    import netCDF4

    histories, fixed = {}, {}
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        check_size(sum(8 * v.size for v in file.variables.values()), path.stat().st_size)
        about = {name: file.getncattr(name) for name in file.ncattrs()}
        time = _values("time", file["time"])
        for name, variable in file.variables.items():
            data, notes = _values(name, variable), vars(variable)
            if variable.dimensions[:1] == ("time",) and name != "time":
                histories[name] = (data, notes)
            elif name != "time":
                fixed[name] = (data[None], notes)
    origin = {n.removeprefix(PROVENANCE): v for n, v in about.items() if n.startswith(PROVENANCE)}
    return restored({"system": path.stem, **about}, time, histories, fixed, origin)


def _values(name: str, variable: Any) -> Array:
    """Return the values of a variable, NaN where the file declares a value as missing (CF
    conventions).
    """
    if not {"_FillValue", "missing_value"} & {*variable.ncattrs()}:
        return numbers(name, variable[...])
    variable.set_auto_mask(True)
    found = np.ma.asanyarray(variable[...])
    return np.where(np.ma.getmaskarray(found), np.nan, numbers(name, found.data))
