# SPDX-License-Identifier: BSD-2-Clause
"""Where a component runs: what stands behind the equals sign of `--on component=...`.

    cortex-m7                          an emulated processor of its own
    cortex-m7:obc                      one that it shares with all that name `obc`
    tcp://host:port, unix:///path      a board that listens there
    serial:///dev/ttyACM0?baud=921600  a board on a serial line

with options behind a question mark: timeout, retries, deadline, late, slot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

from harness.errors import UsageError
from harness.remote.firmware import Part
from harness.remote.remote import on_processor, stand_in
from harness.remote.targets import TARGETS, find_target
from harness.spelling import did_you_mean, is_number
from harness.system.model import System

LATE = ("wait", "hold", "stop")


def _seconds(text: str) -> bool:
    return is_number(text) and 0 < float(text) < math.inf


def _count(text: str) -> bool:
    return text.isascii() and text.isdigit() and int(text) < 1 << 31


OPTIONS = {
    "timeout": ("seconds above 0", _seconds),
    "deadline": ("seconds above 0", _seconds),
    "retries": ("a number", _count),
    "slot": ("a number", _count),
    "baud": ("a number", _count),
    "late": ("wait, hold or stop", LATE.__contains__),
}
"""Options of a place: what is expected, and whether a text is that."""


class Place(NamedTuple):
    """target: of an emulator, else ""; group: that share it; settings: for the link."""

    target: str
    group: str
    settings: Mapping[str, str]


def read_place(component: str, text: str) -> Place:
    """A place as the user writes it; UsageError."""
    name, _, query = text.partition("?")
    said = f"--on {component}={text}"
    settings = _options(said, query)
    if "://" in name:
        return Place("", "", {**_address(said, name), **settings})
    target, _, group = name.partition(":")
    if target not in TARGETS:
        near = did_you_mean(target, TARGETS)
        known = f"{', '.join(TARGETS)}, tcp://HOST:PORT, unix:///PATH or serial:///DEVICE"
        raise UsageError(f"{said}: there is no such processor{near}; {known}")
    if group and settings.get("late") == "hold":
        raise UsageError(f"{said}: late=hold needs a processor of its own")
    return Place(target, group, settings)


def _options(said: str, query: str) -> dict[str, str]:
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in given.items():
        if name not in OPTIONS:
            raise UsageError(f"{said}: there is no option {name}{did_you_mean(name, OPTIONS)}")
        expected, fits = OPTIONS[name]
        if not fits(value):
            raise UsageError(f"{said}: {name} expects {expected}, got {value}")
    return given


def _address(said: str, name: str) -> dict[str, str]:
    """Settings of an address as it was typed: urlsplit() drops line breaks in silence."""
    with suppress(ValueError):  # of a port or a host that is none
        if not name.isprintable():
            raise ValueError(name)
        url = urlsplit(name)
        if url.scheme == "tcp" and url.hostname and url.port:
            return {"via": "tcp", "host": url.hostname, "port": str(url.port)}
        if url.scheme in ("unix", "serial") and url.path.strip("/") and not url.netloc:
            return {"via": url.scheme, "path": url.path}
    raise UsageError(f"{said}: expected tcp://HOST:PORT, unix:///PATH or serial:///DEVICE")


def move(system: System, places: Mapping[str, Place]) -> System:
    """The system with link FMUs in place of these components; their parameters and wires stay.

    Raises UsageError (tools that are missing), FmuError (an FMU that does not build there).
    """
    fmus = {c.name: c.fmu for c in system.components}
    moved = {n: stand_in(fmus[n], p.settings) for n, p in places.items() if not p.target}
    for (target, group), names in _processors(places).items():
        parts = [Part(name, fmus[name]) for name in names]
        word, settings = group if len(parts) > 1 else "", places[names[0]].settings
        moved |= zip(names, on_processor(parts, find_target(target), word, settings), strict=True)
    components = tuple(replace(c, fmu=moved.get(c.name, c.fmu)) for c in system.components)
    return replace(system, components=components)


def _processors(places: Mapping[str, Place]) -> dict[tuple[str, str], list[str]]:
    """Components by the processor that they run on; without a group each has its own."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, place in places.items():
        if place.target:
            found.setdefault((place.target, place.group or f" {name}"), []).append(name)
    return found
