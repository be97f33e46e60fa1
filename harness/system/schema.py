# SPDX-License-Identifier: BSD-2-Clause
"""Tables that people write in TOML, held against what they are declared to be: all that is wrong at
once, a line each.

A table of known entries is a msgspec.Struct, `Struct | None` where it may be missing; one of any
entries is a `dict[str, X]`. What stands in them is one of the types below, or another that msgspec
knows; msgspec.convert(table, Struct) makes an object of a table without problems.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from sys import float_info
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import msgspec
from msgspec import Meta

from harness.spelling import did_you_mean

LARGEST = float_info.max

Text = Annotated[str, Meta(description="a text")]
Flag = Annotated[bool, Meta(description="true or false")]
Number = Annotated[float, Meta(ge=-LARGEST, le=LARGEST, description="a finite number")]
Positive = Annotated[float, Meta(gt=0, le=LARGEST, description="a finite number above 0")]
Whole = Annotated[int, Meta(ge=0, description="a whole number of at least 0")]
Count = Annotated[int, Meta(ge=1, description="a whole number of at least 1")]


def problems(given: Any, kind: Any, place: str = "") -> Iterator[str]:
    """What is wrong with a value that should be of a kind, a line each: entry, rule and value.

    place: how the entry is called, "" for the whole file.
    """
    if NoneType in get_args(kind):  # TOML knows no None
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    table = get_origin(kind) is dict
    if not table and not _is_struct(kind):
        try:
            msgspec.convert(given, kind)
        except msgspec.ValidationError as error:
            yield f"{place}: must be {_words(kind, error)}, not {given!r:.80}"
    elif not isinstance(given, Mapping):
        yield f"{place}: must be a table, not {given!r:.80}"
    elif table:
        for name, value in given.items():
            yield from problems(value, get_args(kind)[1], _inside(place, name))
    else:
        yield from _of_entries(given, kind, place)


def _of_entries(given: Mapping[str, Any], kind: type[msgspec.Struct], place: str) -> Iterator[str]:
    fields = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    for name, value in given.items():
        if name in fields:
            yield from problems(value, fields[name].type, _inside(place, name))
        else:
            close = did_you_mean(name, fields)
            yield f"{_inside(place, name)}: there is no such entry{close}"
    for name, field in fields.items():
        if field.required and name not in given:
            yield f"{_inside(place, name)}: is missing"


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _inside(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


def _words(kind: Any, error: Exception) -> str:
    """What a value must be: as its type says, else as msgspec says."""
    metas = [each for each in get_args(kind)[1:] if isinstance(each, Meta) and each.description]
    return str(metas[0].description if metas else str(error).removeprefix("Expected "))
