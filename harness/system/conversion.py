# SPDX-License-Identifier: BSD-2-Clause
"""What a signal or parameter is worth where it arrives: after units, transformations and names of
enumeration items.
"""

from __future__ import annotations

from collections.abc import Mapping

from harness.spelling import did_you_mean
from harness.system.interface import Interface, Variable
from harness.system.model import Connection, Parameter
from harness.system.units import IDENTITY, Affine, Unit, compose
from harness.system.values import Scalar, coerce


def way(connection: Connection, interfaces: Mapping[str, Interface]) -> Affine:
    """What happens to a signal between its output and its input; ValueError if the units do not
    fit.
    """
    ends = [(interfaces[port.component], port.variable) for port in connection[:2]]
    units = [interface.unit(interface.variables[variable]) for interface, variable in ends]
    if not connection.hops and units[0] and units[1] and units[0].name == units[1].name:
        return IDENTITY
    return compose(units[0], connection.hops, units[1])


def final(parameter: Parameter, variable: Variable, interface: Interface) -> Scalar:
    """Value of a parameter in type and unit of its variable; ValueError if it has none."""
    value = parameter.value
    if variable.type == "Enumeration" and isinstance(value, str):
        return _item(variable, value)
    if not parameter.hops and parameter.unit in (None, variable.unit):
        return coerce(value, variable.type)
    start = None if parameter.unit is None else parameter.meaning or Unit(parameter.unit)
    change = compose(start, parameter.hops, interface.unit(variable))
    return (
        coerce(value, variable.type)
        if change == IDENTITY
        else coerce(change(_number(value)), variable.type)
    )


def _item(variable: Variable, name: str) -> int:
    if name not in variable.items:
        close = did_you_mean(name, variable.items)
        raise ValueError(f"there is no item '{name}'{close}, only {', '.join(variable.items)}")
    return variable.items[name]


def _number(value: Scalar) -> float:
    if isinstance(value, str):
        raise ValueError(f"'{value}' is not a number, it cannot be transformed")
    return float(value)
