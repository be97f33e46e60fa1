# SPDX-License-Identifier: BSD-2-Clause
"""The FMU that stands for a component elsewhere: the description of the component, the library of
the link, and what the link has to know.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from fmpy import platform, sharedLibraryExtension
from lxml import etree

from harness.errors import UsageError
from harness.files import cache
from harness.files.archive import pack, parsed, read_entry
from harness.files.paths import built, link_sources
from harness.remote.firmware import Part, build
from harness.remote.targets import Target

FIRMWARE = "resources/firmware.elf"
SETTINGS = "resources/link.txt"

PIPES = "enable=on,target=native,arg=%/to_board,arg=%/from_board"
"""Semihosting of the emulator: the firmware opens the two pipes that its command line names."""

QUIET = ("-display", "none", "-monitor", "none", "-serial", "none")


def stand_in(fmu: Path, settings: Mapping[str, str]) -> Path:
    """The link FMU for a component that is reached as the settings say."""
    return _made(fmu, list(settings.items()), b"")


def on_processor(
    parts: Sequence[Part], target: Target, group: str, settings: Mapping[str, str]
) -> list[Path]:
    """The link FMUs for components that share one emulated processor, in their order.

    group: "" for a component alone, else a name that the links of one processor share.
    """
    firmware = _firmware(parts, target)
    word = hashlib.sha256(firmware + group.encode()).hexdigest()[:16] if group else ""
    emulator = (*target.emulator, *QUIET, "-semihosting-config", PIPES, "-kernel", "@/firmware.elf")
    made = []
    for slot, part in enumerate(parts):
        lines = [("via", "emulator"), ("target", target.name), ("slot", str(slot))]
        lines += [("group", word), *settings.items(), *(("argument", a) for a in emulator)]
        made.append(_made(part.fmu, lines, firmware))
    return made


def _firmware(parts: Sequence[Part], target: Target) -> bytes:
    """Built, or kept from an earlier run with the same sources and the same tools."""
    tools = b"".join(file.read_bytes() for file in sorted(link_sources().glob("*.[ch]")))
    contents = [f"{part.name}\0".encode() + part.fmu.read_bytes() for part in parts]
    key = b"\0".join([repr(target).encode(), tools, *contents])

    def make(path: Path) -> None:
        path.write_bytes(build(parts, target))

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


def describe(root: etree._Element) -> bytes:
    """The description of a component, for the FMU that stands for it: the same variables, without
    sources and without what a link cannot do.
    """
    model = root.find("CoSimulation")
    for files in model.findall("SourceFiles"):
        model.remove(files)
    for lacking in ("providesDirectionalDerivative", "canInterpolateInputs", "needsExecutionTool"):
        model.attrib.pop(lacking, None)
    model.attrib.pop("maxOutputDerivativeOrder", None)
    for other in root.findall("ModelExchange"):
        root.remove(other)
    categories = root.find("LogCategories")
    if categories is None:
        categories = etree.Element("LogCategories")
        root.find("ModelVariables").addprevious(categories)
    known = {c.get("name") for c in categories}
    for name in ("logStatusError", "logStatusWarning", "logStatistics"):
        if name not in known:
            etree.SubElement(categories, "Category", name=name)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8"))
