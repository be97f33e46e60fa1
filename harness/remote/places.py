# SPDX-License-Identifier: BSD-2-Clause
"""Places at which a component can run: the text after the equals sign of `--on component=...`.

    cortex-m7                          an emulated processor for this component alone
    cortex-m7:obc                      an emulated processor for all components that name `obc`
    tcp://host:port, unix:///path      a board that listens at this address
    serial:///dev/ttyACM0?baud=921600  a board on a serial line

Options follow a question mark: timeout (seconds for an answer), retries (repetitions of a request),
deadline (seconds after which the answer to a step is late), late (reaction to a late answer), slot
(number of the component on the board), baud (rate of a serial line). In the system, a link FMU
represents the component. It consists of the model description of the component, the library of the
link, the settings of the link and, for an emulated processor, the firmware.
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
"""Values of the option `late`: reaction of the link to an answer after the deadline."""


def _seconds(text: str) -> bool:
    return is_number(text) and 0 < float(text) < math.inf


def _count(text: str) -> bool:
    return text.isascii() and text.isdigit() and int(text) < 1 << 31


OPTIONS = {
    "timeout": ("seconds above 0", _seconds),
    "deadline": ("seconds above 0", _seconds),
    "retries": ("a whole number below 2^31", _count),
    "slot": ("a whole number below 2^31", _count),
    "baud": ("a whole number below 2^31", _count),
    "late": ("wait, hold or stop", LATE.__contains__),
}
"""Options of a place by name: the expected value in words, and a function that checks a value."""


class Place(NamedTuple):
    """Place of a component; processor: name of an emulated processor, "" for a board; group: name
    of a processor that several components share, "" for a processor that is not shared; settings:
    settings of the link FMU by name.
    """

    processor: str
    group: str
    settings: Mapping[str, str]


def read_place(component: str, text: str) -> Place:
    """Return the place that the user has given for a component by `--on component=text`; raise
    UsageError if the text is wrong.
    """
    name, _, query = text.partition("?")
    written = f"--on {component}={text}"
    settings = _options(written, query)
    if "://" in name:
        return Place("", "", {**_address(written, name), **settings})
    processor, _, group = name.partition(":")
    if processor not in PROCESSORS:
        near = did_you_mean(processor, PROCESSORS)
        known = f"{', '.join(PROCESSORS)}, tcp://HOST:PORT, unix:///PATH or serial:///DEVICE"
        raise UsageError(f"{written}: there is no such processor{near}; expected {known}")
    if group and settings.get("late") == "hold":
        raise UsageError(f"{written}: late=hold does not apply to a group; omit `:{group}`")
    return Place(processor, group, settings)


def _options(written: str, query: str) -> dict[str, str]:
    """Return the options in `query`, the text after the question mark; written: option --on as
    typed, for error messages. Raises UsageError for an invalid option.
    """
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in given.items():
        if name not in OPTIONS:
            raise UsageError(f"{written}: there is no option {name}{did_you_mean(name, OPTIONS)}")
        expected, fits = OPTIONS[name]
        if not fits(value):
            raise UsageError(f"{written}: {name} expects {expected}, got {value}")
    return given


def _address(written: str, name: str) -> dict[str, str]:
    """Return the settings of the link to a board at an address; raise UsageError if the address is
    wrong. Control characters are rejected, because urlsplit() drops line breaks silently.
    """
    with suppress(ValueError):  # urlsplit() and url.port raise it for a wrong host or port
        if not name.isprintable():
            raise ValueError(name)
        url = urlsplit(name)
        if url.scheme == "tcp" and url.hostname and url.port:
            return {"via": "tcp", "host": url.hostname, "port": str(url.port)}
        if url.scheme in ("unix", "serial") and url.path.strip("/") and not url.netloc:
            return {"via": url.scheme, "path": url.path}
    raise UsageError(f"{written}: expected tcp://HOST:PORT, unix:///PATH or serial:///DEVICE")


def move(system: System, places: Mapping[str, Place]) -> System:
    """Return the system with link FMUs in place of the FMUs of the components in `places`, by name.
    Parameters and connections are unchanged.

    Raises UsageError if tools are missing, FmuError if an FMU cannot be built for its processor.
    """
    fmus = {c.name: c.fmu for c in system.components}
    moved = {n: substitute(fmus[n], p.settings) for n, p in places.items() if not p.processor}
    for (processor, group), names in _processors(places).items():
        parts = [Part(name, fmus[name]) for name in names]
        word, settings = group if len(parts) > 1 else "", places[names[0]].settings
        made = on_processor(parts, find_processor(processor), word, settings)
        moved |= zip(names, made, strict=True)
    components = tuple(replace(c, fmu=moved.get(c.name, c.fmu)) for c in system.components)
    return replace(system, components=components)


def _processors(places: Mapping[str, Place]) -> dict[tuple[str, str], list[str]]:
    """Return the names of the components on each emulated processor, by (name of the processor,
    group). A component without a group has a processor for itself.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for name, place in places.items():
        if place.processor:
            found.setdefault((place.processor, place.group or f" {name}"), []).append(name)
    return found


FIRMWARE = "resources/firmware.elf"
SETTINGS = "resources/link.txt"
"""Paths in a link FMU: firmware (for the emulator @/firmware.elf), settings of the link."""

PIPES = "enable=on,target=native,arg=%/to_board,arg=%/from_board"
"""Semihosting option with the two pipes of the firmware; the link replaces % by their folder."""

QUIET = ("-display", "none", "-monitor", "none", "-serial", "none")
"""Options with which the emulator has no display, monitor and serial line."""


def substitute(fmu: Path, settings: Mapping[str, str]) -> Path:
    """Return the path of the link FMU for a component on a board with the address in settings."""
    return _made(fmu, list(settings.items()), b"")


def on_processor(
    parts: Sequence[Part], processor: Processor, group: str, settings: Mapping[str, str]
) -> list[Path]:
    """Return the paths of the link FMUs for the components of one emulated processor, in the order
    of `parts`.

    group: name of the processor if several components share it, "" for one component; settings:
    settings of the link FMU by name.
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
    """Return the firmware for these components, from the cache if it was built before from the same
    FMUs, link sources and description of the processor.
    """
    tools = b"".join(file.read_bytes() for file in sorted(link_sources().glob("*.[ch]")))
    contents = [f"{part.name}\0".encode() + part.fmu.read_bytes() for part in parts]
    key = b"\0".join([repr(processor).encode(), tools, *contents])

    def make(path: Path) -> None:
        path.write_bytes(build(parts, processor))

    return cache.made("firmware.elf", key, make).read_bytes()


def _made(fmu: Path, lines: Sequence[tuple[str, str]], firmware: bytes) -> Path:
    """Return the path of a link FMU in the cache for the component with this FMU; lines: settings
    of the link, (name, value); firmware: b"" for a board. Raises UsageError if this platform has no
    library of the link, or if a setting contains a line break or NUL.
    """
    library = built("link")
    if library is None:
        raise UsageError("--on: the link library is missing; make builds it on Linux and macOS")
    root = parsed(read_entry(fmu, "modelDescription.xml"))
    name = root.find("CoSimulation").get("modelIdentifier")
    settings = [("guid", root.get("guid")), *lines]
    for _, value in settings:
        if any(c in value for c in "\r\n\0"):
            raise UsageError(f"--on: {value!r}: must not contain a line break or NUL")
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
"""Attributes of the element CoSimulation that state capabilities which a link FMU does not have."""


def describe(root: etree._Element) -> bytes:
    """Return the model description of a link FMU from the model description of the component: the
    same variables, without source files and without capabilities that a link lacks.
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
