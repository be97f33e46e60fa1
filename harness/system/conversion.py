# SPDX-License-Identifier: BSD-2-Clause
"""Conversion of signals for the input that they drive and of parameter values for the variable that
they set: units, transformations and names of enumeration items.
"""

from __future__ import annotations

from collections.abc import Sequence

from harness.spelling import did_you_mean
from harness.system.interface import Interface, Interfaces
from harness.system.model import Connection, Parameter
from harness.system.units import IDENTITY, Affine, Hop, UndefinedUnitError, Unit, compose
from harness.system.values import Scalar, Variable, coerce


def way(connection: Connection, interfaces: Interfaces, strict: bool = False) -> Affine:
    """Return the conversion of a signal from the output to the input of a connection.

    A unit without a definition is not converted. Raises ValueError if the units are not compatible,
    UndefinedUnitError for a unit without a definition if `strict`.
    """
    ends = [(interfaces[port.component], port.variable) for port in connection[:2]]
    units = [interface.unit(interface.variables[variable]) for interface, variable in ends]
    if not connection.hops and units[0] and units[1] and units[0].name == units[1].name:
        return IDENTITY
    return _composed(units[0], connection.hops, units[1], strict)


def _composed(start: Unit | None, hops: Sequence[Hop], end: Unit | None, strict: bool) -> Affine:
    try:
        return compose(start, hops, end)
    except UndefinedUnitError:
        if strict:
            raise
        return compose(None, [hop._replace(convert=False) for hop in hops], None)


def final(parameter: Parameter, variable: Variable, interface: Interface) -> Scalar:
    """Return the value of a parameter in the type and unit of its variable.

    If the file of another tool uses a unit without a definition, the value is not converted. Raises
    ValueError if the value cannot be converted.
    """
    value = parameter.value
    if variable.type == "Enumeration" and isinstance(value, str):
        if value not in variable.items:
            names = f"{did_you_mean(value, variable.items)}, only {', '.join(variable.items)}"
            raise ValueError(f"the enumeration has no item '{value}'{names}")
        return variable.items[value]
    if parameter.hops or parameter.unit not in (None, variable.unit):
        ends = _start(parameter, interface), interface.unit(variable)
        change = _composed(ends[0], parameter.hops, ends[1], strict=not parameter.optional)
        if change != IDENTITY and isinstance(value, str):
            raise ValueError(f"'{value}' is not a number, so it cannot be converted")
        value = value if change == IDENTITY else change(float(value))
    return coerce(value, variable.type, variable.access)


def _start(parameter: Parameter, interface: Interface) -> Unit | None:
    """Return the unit in which a parameter is given, None if the file states no unit. The
    definition of the unit is from the file, or else from the FMU.
    """
    if parameter.unit is None:
        return None
    return parameter.meaning or Unit(parameter.unit, interface.units.get(parameter.unit))


def is_unconverted(parameter: Parameter, variable: Variable, interface: Interface) -> bool:
    """Return whether a parameter is used without conversion because its unit has no definition."""
    try:
        compose(_start(parameter, interface), parameter.hops, interface.unit(variable))
    except ValueError as error:
        return isinstance(error, UndefinedUnitError)
    return False
