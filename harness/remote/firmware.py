# SPDX-License-Identifier: BSD-2-Clause
"""Firmware for a processor from the sources inside FMUs, with the board's end of the protocol."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import fmpy

from harness.errors import FmuError, UsageError
from harness.files.archive import parsed, read_entry, unpack
from harness.files.paths import link_sources
from harness.remote.targets import SPECS, Target
from harness.system.interface import Interface, read_interface

FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-common"),
    *("-ffunction-sections", "-fdata-sections"),
    "-DLONGEST_CALL=64",
)
"""As for every other machine (the same bits), only what is used goes into the image, and what an
instance keeps of a master's calls is small: 2 kB instead of 20.
"""

LIBRARY = f"--specs={SPECS}"
HEADERS = f"-isystem{Path(fmpy.__file__).parent / 'c-code'}"

BOARD = ("board.c", "firmware.c", "soft_double.c")


class Part(NamedTuple):
    """A component that goes into the firmware."""

    name: str
    fmu: Path


class Sizes(NamedTuple):
    """Bytes of an FMU in the image: code, constants, variables; library: code of the C and
    mathematical libraries in the whole firmware.
    """

    code: int
    constants: int
    data: int
    library: int


KINDS = {
    "text": "code",
    **dict.fromkeys(("rodata", "srodata"), "constants"),
    **dict.fromkeys(("data", "sdata", "bss", "sbss"), "data"),
}
"""What the sections of an image hold, by their first names."""


@cache
def software() -> dict[str, str]:
    """The functions of FMI 2.0 behind the members of struct Software (board.h), in their order."""
    header = (link_sources() / "board.h").read_text(encoding="utf-8")
    return {member: name for name, member in re.findall(r"(fmi2\w+)TYPE \*(\w+);", header)}


def functions(interface: Interface) -> dict[str, str]:
    """The functions of an FMU that a board calls, by the member of struct Software."""
    model = interface.model.coSimulation
    saves = model.canGetAndSetFMUstate and model.canSerializeFMUstate
    return {m: name for m, name in software().items() if saves or "FMUstate" not in name}


def build(parts: Sequence[Part], target: Target) -> bytes:
    """The firmware of these components as an ELF file.

    Raises FmuError (no sources, or they do not compile for this processor).
    """
    with TemporaryDirectory(prefix="harness-firmware-") as place:
        return _linked(parts, target, Path(place)).read_bytes()


def sizes(fmu: Path, target: Target) -> Sizes:
    """What an FMU takes in the firmware, without the board's end of the protocol; raises what
    build() raises.
    """
    with TemporaryDirectory(prefix="harness-firmware-") as place:
        linked = _linked([Part("component", fmu)], target, Path(place))
        return _sizes(linked.with_suffix(".map").read_text(encoding="utf-8"))


def _linked(parts: Sequence[Part], target: Target, folder: Path) -> Path:
    """Path of firmware.elf in the folder, beside the map of the linker."""
    objects = [_component(i, part, target, folder) for i, part in enumerate(parts)]
    (folder / "components.c").write_text(_table(parts, target), encoding="utf-8")
    board = [*(link_sources() / name for name in BOARD), folder / "components.c"]
    elf = folder / "firmware.elf"
    include = [f"-I{link_sources()}", HEADERS]
    link = [LIBRARY, *_memory(target), "--oslib=semihost", "--crt0=semihost", "-Wl,--gc-sections"]
    out = [f"-Wl,-Map={elf.with_suffix('.map')}", "-lm", "-o", elf]
    command = [*_compiler(target), *include, *board, *objects, *link, *out]
    _run(command, f"the firmware for {target.name} cannot be linked")
    return elf


_PLACED = re.compile(r"^ (\.\S+)\n? +0x[0-9a-f]+\s+(0x[0-9a-f]+) (\S+)$", re.MULTILINE)
"""A section in the map of GNU ld: its name, its size, the file that it comes from."""


def _sizes(text: str) -> Sizes:
    """Sums over the sections of the FMU, and of the libraries that the firmware needs, by kind."""
    placed = text[text.index("Linker script and memory map") :]
    found = dict.fromkeys(Sizes._fields, 0)
    for section, size, file in _PLACED.findall(placed):
        kind = KINDS.get(section.split(".")[1], "")
        if kind and "component0.o" in file:
            found[kind] += int(size, 16)
        elif kind == "code" and ".a(" in file:
            found["library"] += int(size, 16)
    return Sizes(**found)


def _compiler(target: Target) -> list[str]:
    return [target.compiler, *FLAGS, *target.flags]


def _memory(target: Target) -> Iterator[str]:
    """The symbols that picolibc's linker script asks for."""
    for kind, (start, size) in (("flash", target.flash), ("ram", target.ram)):
        yield f"-Wl,--defsym=__{kind}={start:#x}"
        yield f"-Wl,--defsym=__{kind}_size={size:#x}"


def _component(number: int, part: Part, target: Target, folder: Path) -> Path:
    """One object of all sources of an FMU, of which only its FMI functions can be seen, under
    names of their own.
    """
    interface = read_interface(part.fmu)
    if interface.fmi != 2:
        raise FmuError(f"{part.name}: {part.fmu.name} is of FMI 3.0, a board speaks FMI 2.0")
    place = folder / f"component{number}"
    unpack(part.fmu, place)
    sources = _sources(part.fmu, place / "sources")
    seen = functions(interface).values()
    whole, names = place.with_suffix(".o"), place.with_suffix(".names")
    include = [f"-I{place / 'sources'}", HEADERS]
    why = f"{part.fmu.name} does not compile for {target.name}"
    compile_c = [*_compiler(target), LIBRARY, *include, "-c"]
    objects = [place / f"{i}.o" for i in range(len(sources))]
    for source, made in zip(sources, objects, strict=True):
        _run([*compile_c, source, "-o", made], why)
    _run([*_compiler(target), "-r", "-nostdlib", *objects, "-o", whole], why)
    names.write_text("".join(f"{n}\n" for n in seen), encoding="utf-8")
    objcopy = f"{target.tools}objcopy"
    _run([objcopy, f"--keep-global-symbols={names}", whole], why)
    names.write_text("".join(f"{n} c{number}_{n}\n" for n in seen), encoding="utf-8")
    _run([objcopy, f"--redefine-syms={names}", whole], why)
    return whole


def _sources(fmu: Path, folder: Path) -> list[Path]:
    root = parsed(read_entry(fmu, "modelDescription.xml"))
    names = [file.get("name") for file in root.findall("CoSimulation/SourceFiles/File")]
    if not names or not folder.is_dir():
        raise FmuError(f"{fmu.name} holds no sources, and firmware is built from nothing else")
    return [folder / name for name in names]


def _run(command: Sequence[object], why: str) -> None:
    """A compiler that says in one line what it does not like; FmuError."""
    try:
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    except OSError as error:
        raise UsageError(f"{command[0]} cannot be run ({error.strerror})") from error
    if done.returncode:
        said = done.stderr.splitlines() or ["the compiler gives no reason"]
        first = next((line for line in said if "error" in line or "undefined" in line), said[0])
        complaint = re.sub(r"^\S*/", "", first).strip()  # without the folder it was found in
        raise FmuError(f"{why}: {complaint}")


def _table(parts: Sequence[Part], target: Target) -> str:
    """components.c: what board.h calls the software of a board."""
    lines = ['#include "board.h"', "const char target_name[] = " + _quoted(target.name) + ";"]
    rows = []
    for i, part in enumerate(parts):
        interface = read_interface(part.fmu)
        known = functions(interface)
        lines += [f"extern {f}TYPE c{i}_{f};" for f in known.values()]
        members = ", ".join(f".{member} = c{i}_{f}" for member, f in known.items())
        about = f"{_quoted(part.name)}, {_quoted(interface.model.guid)}"
        rows.append(f"    {{{about}, {len(interface.variables)}, {members}}},")
    lines += [f"const Software software[{len(parts)}] = {{", *rows, "};"]
    lines += [f"Slot slot[{len(parts)}];", f"const size_t software_count = {len(parts)};", ""]
    return "\n".join(lines)


def _quoted(text: str) -> str:
    escaped = "".join(
        c if c.isalnum() or c in " _-{}.[]" else f"\\{ord(c) & 255:03o}" for c in text
    )
    return f'"{escaped}"'
