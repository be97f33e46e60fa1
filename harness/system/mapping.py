# SPDX-License-Identifier: BSD-2-Clause
"""Mapping of ports of a third-party FMU to the ports of a component with other names.

The user gives pairs of names. Names that differ only in the style of their indices (`r[0]`, `r_1`,
`r(1)` for `r[1]`) are mapped automatically.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

from harness.spelling import did_you_mean
from harness.system.values import Index, grid, parts_of

Names = dict[str, str]
"""Name of a scalar variable in the system by its name in the new FMU."""


class Family(NamedTuple):
    """Scalar, vector or matrix that scalar variables form: its name, its elements in order, its
    shape.
    """

    name: str
    elements: tuple[str, ...]
    shape: Index


# ---- signals with indices in any style

_UNDERSCORED = re.compile(r"(.+?)((?:_\d{1,4})+)", re.ASCII | re.DOTALL)
_ROUND = re.compile(r"(.+)\((\d{1,4}(?: *, *\d{1,4})*)\)", re.ASCII | re.DOTALL)


def families(names: Collection[str]) -> Mapping[str, Family]:
    """Return the vectors, matrices and scalars that scalar variables form, by name. A variable
    counts as a scalar unless it is part of a complete vector or matrix whose indices all begin at 0
    or all at 1.
    """
    return _families(tuple(names))


@lru_cache(maxsize=256)
def _families(names: tuple[str, ...]) -> Mapping[str, Family]:
    groups: dict[tuple[str, str], dict[Index, str]] = {}
    for name in names:
        stem, style, place = _read(name)
        groups.setdefault((stem, style), {})[place] = name
    stems = Counter(stem for stem, _ in groups)
    found: dict[str, Family] = {}
    for (stem, _), members in groups.items():
        whole = grid(members) if () not in members and stems[stem] == 1 else None
        first = set(whole.first) if whole else set()
        if whole and first <= {0, 1} and len(first) == 1:
            elements = tuple(members[place] for place in sorted(members))
            found[stem] = Family(stem, elements, whole.shape)
        else:
            found |= {name: Family(name, (name,), ()) for name in members.values()}
    return found


def _read(text: str) -> tuple[str, str, Index]:
    """Return the parts of the name of an element: name of its vector or matrix, style of its
    indices ("[", "(", "_" or ""), and indices.
    """
    name = parts_of(text)
    if name.element:
        return name.variable, "[", name.element
    if match := _ROUND.fullmatch(text):
        return match[1], "(", tuple(map(int, match[2].split(",")))
    if match := _UNDERSCORED.fullmatch(text):
        return match[1], "_", tuple(map(int, match[2][1:].split("_")))
    return text, "", ()


# ---- names from the user, and names that differ only in style


def given_names(
    given: Sequence[tuple[str, str]], theirs: Collection[str], ours: Collection[str]
) -> Names:
    """Return the mapping of scalar variables for pairs that a user has given: (name in the FMU,
    name in the system), each of a scalar or of a whole vector or matrix.

    theirs, ours: existing scalar variables of the FMU and of the system. Raises ValueError for a
    name that does not exist (with close matches), sizes that differ, and a name in the FMU that is
    given twice.
    """
    their_families, our_families, names = families(theirs), families(ours), Names()
    for their, our in given:
        a = _members(their, theirs, their_families, "the FMU has no such port")
        b = _members(our, ours, our_families, "the system has no such signal")
        if len(a) != len(b):
            raise ValueError(f"{their}={our}: {their} has {len(a)} elements, {our} has {len(b)}")
        if double := [name for name in a if name in names]:
            raise ValueError(f"{their}={our}: {double[0]} is given twice")
        names |= dict(zip(a, b, strict=True))
    return names


def has_port(name: str, theirs: Collection[str]) -> bool:
    """Return whether an FMU with the scalar ports `theirs` has a scalar, vector or matrix of this
    name.
    """
    return name in theirs or name in families(theirs)


def _members(
    name: str, known: Collection[str], groups: Mapping[str, Family], missing: str
) -> tuple[str, ...]:
    if name in known:
        return (name,)
    if name in groups:
        return groups[name].elements
    raise ValueError(f"{name}: {missing}{did_you_mean(name, {*known, *groups})}")


def by_style(theirs: Collection[str], ours: Collection[str]) -> dict[Family, Family]:
    """Return the vectors and matrices of the system (`ours`) by the vectors and matrices of an FMU
    (`theirs`) that have the same name and shape, but indices in another style, as `x_1` and `x[1]`.
    """
    mine = families(ours)
    return {
        each: mine[name]
        for name, each in families(theirs).items()
        if each.shape
        and name in mine
        and each.shape == mine[name].shape
        and each.elements != mine[name].elements
    }
