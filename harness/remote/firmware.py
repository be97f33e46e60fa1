# SPDX-License-Identifier: BSD-2-Clause
"""Firmware for flight processors, built from the source code inside FMUs and the board's side of
the link protocol. Also the list of processors (processors.toml) and a check for their tools.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import fmpy

from harness.errors import FmuError, UsageError
from harness.files.paths import link_sources
from harness.spelling import did_you_mean, first_error
from harness.system.interface import Interface, read_interface, unpacked_sources

# ---- processors


SPECS = "picolibc.specs"
"""Specs file of gcc that selects the C library picolibc, its start-up code and linker script."""


class Processor(NamedTuple):
    """Processor for which firmware can be built.

    text: description; tools: prefix of the compiler's name; flags: of the compiler; flash, ram:
    first address and size of the memory [bytes]; emulator: command that starts the emulator;
    packages: Debian packages that provide the tools; clock: frequency of flight boards of this kind
    [Hz].
    """

    name: str
    text: str
    tools: str
    flags: tuple[str, ...]
    flash: tuple[int, int]
    ram: tuple[int, int]
    emulator: tuple[str, ...]
    packages: str
    clock: float

    @property
    def compiler(self) -> str:
        """Return the name of the gcc for this processor."""
        return f"{self.tools}gcc"


def _processor(name: str, entries: dict[str, Any]) -> Processor:
    words = {key: tuple(entries[key].split()) for key in ("flags", "emulator")}
    places = {key: tuple(entries[key]) for key in ("flash", "ram")}
    return Processor(name, **{**entries, **words, **places})


_FILE = Path(__file__).with_name("processors.toml").read_text(encoding="utf-8")

PROCESSORS = {name: _processor(name, entries) for name, entries in tomllib.loads(_FILE).items()}


def find_processor(name: str) -> Processor:
    """Return the processor with this name; raise UsageError if there is none, or if a tool for it
    is not installed.
    """
    if name not in PROCESSORS:
        near, known = did_you_mean(name, PROCESSORS), ", ".join(PROCESSORS)
        raise UsageError(f"{name}: there is no such processor{near}; known: {known}")
    if lacking := missing(PROCESSORS[name]):
        raise UsageError(lacking)
    return PROCESSORS[name]


def missing(processor: Processor) -> str:
    """Return one line that states which tools for a processor are not installed and how to install
    them; "" if all are installed.
    """
    tools = (processor.compiler, f"{processor.tools}objcopy", processor.emulator[0])
    lacking = [tool for tool in tools if shutil.which(tool) is None]
    if processor.compiler not in lacking and not _has_library(processor):
        lacking.append(f"picolibc of {processor.compiler}")
    if not lacking:
        return ""
    get = f"make pil, or apt-get install {processor.packages}"
    return f"{processor.name} needs {' and '.join(lacking)}: {get}"


@cache
def _has_library(processor: Processor) -> bool:
    """Return whether gcc finds the specs file of picolibc. A gcc that does not find the file prints
    its name without a folder.
    """
    command = [processor.compiler, f"-print-file-name={SPECS}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return found != SPECS


# ---- firmware


FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-common"),
    *("-ffunction-sections", "-fdata-sections"),
    "-DLONGEST_CALL=64",
)
"""Flags of the compiler. The flags in the first line make results bit-identical on all machines.
The second line lets the linker leave out unused functions. An instance stores its last calls
that get or set variables, each with up to LONGEST_CALL value references; with 64 instead of 1024
references, the stored calls need 2 kB instead of 20 kB.
"""

LIBRARY = f"--specs={SPECS}"
HEADERS = f"-isystem{Path(fmpy.__file__).parent / 'c-code'}"

BOARD = ("board.c", "firmware.c", "memory.c", "soft_double.c")
"""Source files of the board's side of the link, in fmus/core/link."""


class Part(NamedTuple):
    """Component that a firmware contains: its name in the system, and its FMU."""

    name: str
    fmu: Path


class Sizes(NamedTuple):
    """Size of an FMU in a firmware [bytes]: machine code, constants, and variables (data); library:
    machine code of the C and mathematical libraries in the whole firmware.
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
"""Field of Sizes to which the size of a section is added, by the first part of the section's
name.
"""


@cache
def software() -> dict[str, str]:
    """Return the names of FMI 2.0 functions by the member of struct Software (board.h) that points
    to each, in the order of the members.
    """
    header = (link_sources() / "board.h").read_text(encoding="utf-8")
    return {member: name for name, member in re.findall(r"(fmi2\w+)TYPE \*(\w+);", header)}


def functions(interface: Interface) -> dict[str, str]:
    """Return the names of the functions of an FMU that a board calls, by the member of struct
    Software (board.h). Functions for saved states are included only if the FMU supports them.
    """
    model = interface.model.coSimulation
    saves = model.canGetAndSetFMUstate and model.canSerializeFMUstate
    return {m: name for m, name in software().items() if saves or "FMUstate" not in name}


def build(parts: Sequence[Part], processor: Processor) -> bytes:
    """Return the content of an ELF file with the firmware for these components.

    Raises FmuError if an FMU is of FMI 3.0 or has no source code, or if it cannot be built.
    """
    with TemporaryDirectory(prefix="harness-firmware-") as place:
        return _linked(parts, processor, Path(place)).read_bytes()


def sizes(fmu: Path, processor: Processor) -> Sizes:
    """Return the size of an FMU in a firmware, without the board's side of the link; raise the
    errors of build().
    """
    with TemporaryDirectory(prefix="harness-firmware-") as place:
        linked = _linked([Part("component", fmu)], processor, Path(place))
        return _sizes(linked.with_suffix(".map").read_text(encoding="utf-8"))


def _linked(parts: Sequence[Part], processor: Processor, folder: Path) -> Path:
    """Build the firmware and return the path of firmware.elf in the folder; the linker writes
    firmware.map beside it.
    """
    objects = [_component(i, part, processor, folder) for i, part in enumerate(parts)]
    (folder / "components.c").write_text(_table(parts, processor), encoding="utf-8")
    board = [*(link_sources() / name for name in BOARD), folder / "components.c"]
    elf = folder / "firmware.elf"
    include = [f"-I{link_sources()}", HEADERS]
    link = [LIBRARY, *_memory(processor), "--oslib=semihost", "--crt0=semihost"]
    out = ["-Wl,--gc-sections", f"-Wl,-Map={elf.with_suffix('.map')}", "-lm", "-o", elf]
    command = [*_compiler(processor), *include, *board, *objects, *link, *out]
    _run(command, f"the firmware for {processor.name} cannot be linked")
    return elf


_PLACED = re.compile(r"^ (\.\S+)\n? +0x[0-9a-f]+\s+(0x[0-9a-f]+) (\S+)$", re.MULTILINE)
"""Regular expression of a section in the map file of GNU ld: name, size, and object file."""


def _sizes(text: str) -> Sizes:
    """Return the total sizes of the sections of the first FMU and of the libraries; text: map file
    of the linker.
    """
    placed = text[text.index("Linker script and memory map") :]
    found = dict.fromkeys(Sizes._fields, 0)
    for section, size, file in _PLACED.findall(placed):
        kind = KINDS.get(section.split(".")[1], "")
        if kind and "component0.o" in file:
            found[kind] += int(size, 16)
        elif kind == "code" and ".a(" in file:
            found["library"] += int(size, 16)
    return Sizes(**found)


def _compiler(processor: Processor) -> list[str]:
    return [processor.compiler, *FLAGS, *processor.flags]


def _memory(processor: Processor) -> Iterator[str]:
    """Yield linker flags that define the processor's memory for the linker script of picolibc."""
    for kind, (start, size) in (("flash", processor.flash), ("ram", processor.ram)):
        yield f"-Wl,--defsym=__{kind}={start:#x}"
        yield f"-Wl,--defsym=__{kind}_size={size:#x}"


def _component(number: int, part: Part, processor: Processor, folder: Path) -> Path:
    """Compile all sources of an FMU into one object file, and return its path. The object exports
    only the FMI functions, with the prefix `c0_` for component 0, so that names are unique.
    """
    interface = read_interface(part.fmu)
    if interface.fmi != 2:
        raise FmuError(f"{part.name}: {part.fmu.name} is of FMI 3.0; processors need FMI 2.0")
    place = folder / f"component{number}"
    sources = unpacked_sources(part.fmu, place)
    if not sources:
        raise FmuError(
            f"{part.fmu.name} contains no source code, which is required to build firmware"
        )
    seen = functions(interface).values()
    whole, names = place.with_suffix(".o"), place.with_suffix(".names")
    include = [f"-I{place / 'sources'}", HEADERS]
    why = f"{part.fmu.name} does not compile for {processor.name}"
    compile_c = [*_compiler(processor), LIBRARY, *include, "-c"]
    objects = [place / f"{i}.o" for i in range(len(sources))]
    for source, made in zip(sources, objects, strict=True):
        _run([*compile_c, source, "-o", made], why)
    _run([*_compiler(processor), "-r", "-nostdlib", *objects, "-o", whole], why)
    names.write_text("".join(f"{n}\n" for n in seen), encoding="utf-8")
    objcopy = f"{processor.tools}objcopy"
    _run([objcopy, f"--keep-global-symbols={names}", whole], why)
    names.write_text("".join(f"{n} c{number}_{n}\n" for n in seen), encoding="utf-8")
    _run([objcopy, f"--redefine-syms={names}", whole], why)
    return whole


def _run(command: Sequence[object], why: str) -> None:
    """Run a tool of the compiler; raise FmuError with `why` and the first error line if it fails,
    UsageError if it cannot be started.
    """
    try:
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    except OSError as error:
        raise UsageError(f"{command[0]} cannot be run ({error.strerror})") from error
    if done.returncode:
        raise FmuError(f"{why}: {first_error(done.stderr)}")


def _table(parts: Sequence[Part], processor: Processor) -> str:
    """Return the text of components.c, which defines the table `software` of board.h: a row with
    the FMI functions of each component.
    """
    lines = ['#include "board.h"', "const char target_name[] = " + _quoted(processor.name) + ";"]
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
    """Return a text as a string literal of C."""
    escaped = "".join(
        c if c.isalnum() or c in " _-{}.[]" else f"\\{ord(c) & 255:03o}" for c in text
    )
    return f'"{escaped}"'
