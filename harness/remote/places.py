# SPDX-License-Identifier: BSD-2-Clause
"""Places at which a component runs: the text after the equals sign of `--on component=...`.

    cortex-m7                          an emulated processor of its own
    cortex-m7:obc                      a processor shared by all components that name `obc`
    tcp://host:port, unix:///path      a board that listens there
    serial:///dev/ttyACM0?baud=921600  a board on a serial line

Options follow a question mark: timeout, retries, deadline, late, slot. An FMU represents the
component in the system: the description of the component, the library of the link, and the settings
of the link.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

from fmpy import platform, sharedLibraryExtension
from lxml import etree

from harness.errors import UsageError
from harness.files import cache
from harness.files.archive import pack, parsed, read_entry, serialized
from harness.files.paths import built, link_sources
from harness.remote.firmware import PROCESSORS, Part, Processor, build, find_processor
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
"""Options of a place: the expected value in words, and a function that checks a text."""


class Place(NamedTuple):
    """Place of a component; processor: name of an emulated processor, else ""; group: name of a
    shared processor; settings: for the link.
    """

    processor: str
    group: str
    settings: Mapping[str, str]


def read_place(component: str, text: str) -> Place:
    """Return a place from the text of the user; raise UsageError."""
    name, _, query = text.partition("?")
    written = f"--on {component}={text}"
    settings = _options(written, query)
    if "://" in name:
        return Place("", "", {**_address(written, name), **settings})
    processor, _, group = name.partition(":")
    if processor not in PROCESSORS:
        near = did_you_mean(processor, PROCESSORS)
        known = f"{', '.join(PROCESSORS)}, tcp://HOST:PORT, unix:///PATH or serial:///DEVICE"
        raise UsageError(f"{written}: there is no such processor{near}; {known}")
    if group and settings.get("late") == "hold":
        raise UsageError(f"{written}: late=hold does not apply to a group; omit `:{group}`")
    return Place(processor, group, settings)


def _options(written: str, query: str) -> dict[str, str]:
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in given.items():
        if name not in OPTIONS:
            raise UsageError(f"{written}: there is no option {name}{did_you_mean(name, OPTIONS)}")
        expected, fits = OPTIONS[name]
        if not fits(value):
            raise UsageError(f"{written}: {name} expects {expected}, got {value}")
    return given


def _address(written: str, name: str) -> dict[str, str]:
    """Return the settings of an address as typed, because urlsplit() drops line breaks silently."""
    with suppress(ValueError):  # of a port or a host that is none
        if not name.isprintable():
            raise ValueError(name)
        url = urlsplit(name)
        if url.scheme == "tcp" and url.hostname and url.port:
            return {"via": "tcp", "host": url.hostname, "port": str(url.port)}
        if url.scheme in ("unix", "serial") and url.path.strip("/") and not url.netloc:
            return {"via": url.scheme, "path": url.path}
    raise UsageError(f"{written}: expected tcp://HOST:PORT, unix:///PATH or serial:///DEVICE")


def move(system: System, places: Mapping[str, Place]) -> System:
    """Return the system with link FMUs for these components; their parameters and connections stay.

    Raises UsageError (missing tools), FmuError (an FMU that does not build for the processor).
    """
    fmus = {c.name: c.fmu for c in system.components}
    moved = {n: substitute(fmus[n], p.settings) for n, p in places.items() if not p.processor}
    for (processor, group), names in _processors(places).items():
        parts = [Part(name, fmus[name]) for name in names]
        word, settings = group if len(parts) > 1 else "", places[names[0]].settings
        moved |= zip(
            names, on_processor(parts, find_processor(processor), word, settings), strict=True
        )
    components = tuple(replace(c, fmu=moved.get(c.name, c.fmu)) for c in system.components)
    return replace(system, components=components)


def _processors(places: Mapping[str, Place]) -> dict[tuple[str, str], list[str]]:
    """Return components by the processor on which they run; without a group each has its own."""
    found: dict[tuple[str, str], list[str]] = {}
    for name, place in places.items():
        if place.processor:
            found.setdefault((place.processor, place.group or f" {name}"), []).append(name)
    return found


FIRMWARE = "resources/firmware.elf"
SETTINGS = "resources/link.txt"

PIPES = "enable=on,target=native,arg=%/to_board,arg=%/from_board"
"""Semihosting of the emulator: the firmware opens the two pipes that its command line names."""

QUIET = ("-display", "none", "-monitor", "none", "-serial", "none")


def substitute(fmu: Path, settings: Mapping[str, str]) -> Path:
    """Return the link FMU for a component at the address in the settings."""
    return _made(fmu, list(settings.items()), b"")


def on_processor(
    parts: Sequence[Part], processor: Processor, group: str, settings: Mapping[str, str]
) -> list[Path]:
    """Return the link FMUs for components that share one emulated processor, in order.

    group: "" for a component alone, else a name that the links of one processor share.
    """
    firmware = _firmware(parts, processor)
    word = hashlib.sha256(firmware + group.encode()).hexdigest()[:16] if group else ""
    firmware_options = ("-semihosting-config", PIPES, "-kernel", "@/firmware.elf")
    emulator = (*processor.emulator, *QUIET, *firmware_options)
    made = []
    for slot, part in enumerate(parts):
        lines = [("via", "emulator"), ("target", processor.name), ("slot", str(slot))]
        lines += [("group", word), *settings.items(), *(("argument", a) for a in emulator)]
        made.append(_made(part.fmu, lines, firmware))
    return made


def _firmware(parts: Sequence[Part], processor: Processor) -> bytes:
    """Return the firmware, built or from the cache for the same sources and tools."""
    tools = b"".join(file.read_bytes() for file in sorted(link_sources().glob("*.[ch]")))
    contents = [f"{part.name}\0".encode() + part.fmu.read_bytes() for part in parts]
    key = b"\0".join([repr(processor).encode(), tools, *contents])

    def make(path: Path) -> None:
        path.write_bytes(build(parts, processor))

    return cache.made("firmware.elf", key, make).read_bytes()


def _made(fmu: Path, lines: Sequence[tuple[str, str]], firmware: bytes) -> Path:
    library = built("link")
    if library is None:
        raise UsageError("links to other processors are for Linux and macOS only")
    root = parsed(read_entry(fmu, "modelDescription.xml"))
    name = root.find("CoSimulation").get("modelIdentifier")
    settings = [("guid", root.get("guid")), *lines]
    for _, value in settings:
        if any(c in value for c in "\r\n\0"):
            raise UsageError(f"{value!r}: cannot be written in one line")
    content = {
        "modelDescription.xml": describe(root),
        SETTINGS: "".join(f"{key}={value}\n" for key, value in settings).encode(),
        f"binaries/{platform}/{name}{sharedLibraryExtension}": library.read_bytes(),
    }
    if firmware:
        content[FIRMWARE] = firmware
    key = b"\0".join(part for name in sorted(content) for part in (name.encode(), content[name]))
    return cache.made(fmu.name, key, lambda path: pack(path, content))


LACKING = (
    *("providesDirectionalDerivative", "canInterpolateInputs"),
    *("needsExecutionTool", "maxOutputDerivativeOrder"),
)
"""Capabilities that a link lacks."""


def describe(root: etree._Element) -> bytes:
    """Return the description of the representing FMU: the same variables, without sources and
    without capabilities that a link lacks.
    """
    model = root.find("CoSimulation")
    etree.strip_elements(root, "SourceFiles", "ModelExchange")
    etree.strip_attributes(model, *LACKING)
    categories = root.find("LogCategories")
    if categories is None:
        categories = etree.Element("LogCategories")
        root.find("ModelVariables").addprevious(categories)
    known = {c.get("name") for c in categories}
    for name in ("logStatusError", "logStatusWarning", "logStatistics"):
        if name not in known:
            etree.SubElement(categories, "Category", name=name)
    return serialized(root)
