# SPDX-License-Identifier: BSD-2-Clause
"""What a signal or parameter is worth where it arrives: after units, transformations and names of
enumeration items.
"""

from __future__ import annotations

from collections.abc import Mapping

from harness.spelling import did_you_mean
from harness.system.interface import Interface
from harness.system.model import Connection, Parameter
from harness.system.units import IDENTITY, Affine, UndefinedUnitError, Unit, compose
from harness.system.values import Scalar, Variable, coerce


def way(
    connection: Connection, interfaces: Mapping[str, Interface], strict: bool = False
) -> Affine:
    """What happens to a signal between its output and its input; ValueError if the units do not
    fit.

    Where a unit has no meaning nothing is converted, or if strict, UndefinedUnitError is raised.
    """
    ends = [(interfaces[port.component], port.variable) for port in connection[:2]]
    units = [interface.unit(interface.variables[variable]) for interface, variable in ends]
    if not connection.hops and units[0] and units[1] and units[0].name == units[1].name:
        return IDENTITY
    try:
        return compose(units[0], connection.hops, units[1])
    except UndefinedUnitError:
        if strict:
            raise
        return compose(None, [hop._replace(convert=False) for hop in connection.hops], None)


def final(parameter: Parameter, variable: Variable, interface: Interface) -> Scalar:
    """Value of a parameter in type and unit of its variable; ValueError if it has none."""
    value = parameter.value
    if variable.type == "Enumeration" and isinstance(value, str):
        if value not in variable.items:
            names = f"{did_you_mean(value, variable.items)}, only {', '.join(variable.items)}"
            raise ValueError(f"there is no item '{value}'{names}")
        return variable.items[value]
    if parameter.hops or parameter.unit not in (None, variable.unit):
        change = _change(parameter, variable, interface)
        if change != IDENTITY and isinstance(value, str):
            raise ValueError(f"'{value}' is not a number, it cannot be transformed")
        value = value if change == IDENTITY else change(float(value))
    return coerce(value, variable.type, variable.access)


def _change(parameter: Parameter, variable: Variable, interface: Interface) -> Affine:
    """What happens to the number of a parameter; a unit that its file does not define may be one of
    the FMU's. In files of other tools one that nobody defines changes nothing.
    """
    try:
        return compose(_start(parameter, interface), parameter.hops, interface.unit(variable))
    except UndefinedUnitError:
        if not parameter.optional:
            raise
        return compose(None, [hop._replace(convert=False) for hop in parameter.hops], None)


def _start(parameter: Parameter, interface: Interface) -> Unit | None:
    """The unit that a parameter is given in."""
    if parameter.unit is None:
        return None
    return parameter.meaning or Unit(parameter.unit, interface.units.get(parameter.unit))


def is_unconverted(parameter: Parameter, variable: Variable, interface: Interface) -> bool:
    """Whether a parameter is taken as it is because nobody defines its unit."""
    try:
        compose(_start(parameter, interface), parameter.hops, interface.unit(variable))
    except UndefinedUnitError:
        return True
    except ValueError:
        return False
    return False
