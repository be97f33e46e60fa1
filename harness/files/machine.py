# SPDX-License-Identifier: BSD-2-Clause
"""Processor and file format of a shared library, read from its first bytes (ELF, PE, Mach-O), and
vector instructions of the processor on which this program runs.

A library can be loaded if it has the processor and format of the running Python program.
"""

from __future__ import annotations

import platform
import re
import struct
import sys
from functools import lru_cache
from pathlib import Path

HEAD = 4096
"""Number of first bytes of a library that are enough to find its processor and format."""

ELF = {
    3: "x86", 8: "MIPS", 20: "PowerPC", 21: "PowerPC64", 22: "S/390", 40: "Arm", 62: "x86-64",
    183: "AArch64", 243: "RISC-V", 258: "LoongArch",
}  # fmt: skip
"""Names of processors by the field e_machine of an ELF header."""

PE = {0x14C: "x86", 0x1C0: "Arm", 0x1C4: "Arm", 0x8664: "x86-64", 0xAA64: "AArch64"}
"""Names of processors by the field Machine of a COFF header."""

MACH_O = {7: "x86", 12: "Arm", 0x1000007: "x86-64", 0x100000C: "AArch64"}
"""Names of processors by the field cputype of a Mach-O header."""

FAT = 0xCAFEBABE
"""Magic number of a Mach-O file for several processors, big-endian. Java class files begin with the
same number, followed by a version of at least 45 instead of the number of processors.
"""


def kinds(head: bytes) -> frozenset[str]:
    """Return processor and format of a library, such as "x86-64 (64-bit ELF)": several for a Mach-O
    file for several processors, none for a file that is not a library.

    head: the first bytes of the file, of which HEAD are enough.
    """
    try:
        return frozenset(_elf(head) or _pe(head) or _mach_o(head))
    except struct.error:  # shorter than the header
        return frozenset()


def _elf(head: bytes) -> list[str]:
    if head[:4] != b"\x7fELF" or len(head) < 6 or head[5] not in (1, 2):
        return []
    big = head[5] == 2
    (machine,) = struct.unpack_from(">H" if big else "<H", head, 18)
    bits, order = 32 * head[4], ", big-endian" if big else ""
    return [f"{ELF.get(machine, f'machine {machine}')} ({bits}-bit ELF{order})"]


def _pe(head: bytes) -> list[str]:
    if head[:2] != b"MZ":
        return []
    (at,) = struct.unpack_from("<I", head, 0x3C)
    magic, machine = struct.unpack_from("<4sH", head, at)
    return [f"{PE.get(machine, f'machine {machine:#x}')} (PE)"] if magic == b"PE\0\0" else []


def _mach_o(head: bytes) -> list[str]:
    magic = head[:4]
    for order in "<>":
        if magic in (struct.pack(f"{order}I", 0xFEEDFACE), struct.pack(f"{order}I", 0xFEEDFACF)):
            return [_of_mach_o(struct.unpack_from(f"{order}I", head, 4)[0])]
    if magic == struct.pack(">I", FAT):
        (count,) = struct.unpack_from(">I", head, 4)
        if count < 40:
            types = (struct.unpack_from(">I", head, 8 + 20 * i)[0] for i in range(count))
            return [_of_mach_o(each) for each in types]
    return []


def _of_mach_o(cpu: int) -> str:
    return f"{MACH_O.get(cpu, f'machine {cpu:#x}')} (Mach-O)"


@lru_cache
def own() -> frozenset[str]:
    """Return processor and format of the running Python program as texts such as
    "x86-64 (64-bit ELF)"; several as in kinds(), none if they are unknown.
    """
    for path in (Path("/proc/self/exe"), Path(sys.executable or "")):
        try:
            with path.open("rb") as file:
                return kinds(file.read(HEAD))
        except OSError:
            continue
    return frozenset()


def other_platform(head: bytes) -> str | None:
    """Return the reason why this process cannot load a library with these first bytes, or None."""
    found = kinds(head)
    if not found:
        return "is not a shared library (neither ELF, PE nor Mach-O)"
    if own() and not found & own():
        return f"is for {_listed(found)}, this machine loads {_listed(own())}"
    return None


def _listed(kinds: frozenset[str]) -> str:
    return " and ".join(sorted(kinds))


@lru_cache
def has_avx2() -> bool:
    """Return whether the processor of this machine has the vector instructions AVX2 of x86-64."""
    return "avx2" in _instructions()


def has_avx512() -> bool:
    """Return whether the processor of this machine has the instructions AVX-512 F, DQ and VL."""
    return {"avx512f", "avx512dq", "avx512vl"} <= _instructions()


def _instructions() -> set[str]:
    """Return the flags of the processor in /proc/cpuinfo; empty if it is not an x86-64."""
    known = Path("/proc/cpuinfo")
    text = known.read_text(encoding="utf-8") if known.is_file() else ""
    flags = re.search(r"^flags\s*:(.*)", text, re.M)
    return set(flags[1].split()) if flags and platform.machine() == "x86_64" else set()
