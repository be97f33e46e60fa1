# SPDX-License-Identifier: BSD-2-Clause
"""The processors that firmware can be built for, with the compiler and the emulator of each."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from typing import NamedTuple

from harness.errors import UsageError
from harness.spelling import did_you_mean


class Memory(NamedTuple):
    """A piece of memory: first address and size [bytes]."""

    start: int
    size: int


class Target(NamedTuple):
    """A processor: flags of its compiler, its memory, the command of its emulator, and the packages
    of Debian that bring them.

    clock: of flight boards of this kind, for the share of a sample period [Hz].
    """

    name: str
    text: str
    tools: str
    flags: tuple[str, ...]
    flash: Memory
    ram: Memory
    emulator: tuple[str, ...]
    packages: tuple[str, ...]
    clock: float

    @property
    def compiler(self) -> str:
        """Its gcc."""
        return f"{self.tools}gcc"


MIB = 1024 * 1024

SPECS = "picolibc.specs"
"""Of the C library, with start-up code and linker script."""

SOFT_DOUBLES = tuple(
    f"-Wl,--wrap={name}"
    for name in ("__aeabi_dadd", "__aeabi_dsub", "__aeabi_drsub", "__aeabi_ddiv", "sqrt")
)
"""Of soft_double.c, which rounds right where libgcc does not, and is quicker."""

_CODE = Memory(0x0, 4 * MIB)
_DATA = Memory(0x20000000, 4 * MIB)
_ARM = ("gcc-arm-none-eabi", "picolibc-arm-none-eabi", "qemu-system-arm")
_RISCV = ("gcc-riscv64-unknown-elf", "picolibc-riscv64-unknown-elf", "qemu-system-misc")


def _counting(shift: int) -> tuple[str, ...]:
    """Every instruction takes 2^shift ns, whatever the machine is doing otherwise."""
    return ("-icount", f"shift={shift},sleep=off")


def _arm(name: str, text: str, machine: str, flags: tuple[str, ...], clock: float) -> Target:
    emulator = ("qemu-system-arm", "-M", machine, "-net", "none", *_counting(6))
    return Target(name, text, "arm-none-eabi-", flags, _CODE, _DATA, emulator, _ARM, clock)


def _riscv(bits: int, text: str, abi: str, clock: float) -> Target:
    machine = ("-M", "virt", "-bios", "none", "-m", "16M")
    emulator = (f"qemu-system-riscv{bits}", *machine, *_counting(0))
    flags = (f"-march=rv{bits}imafdc", f"-mabi={abi}", "-mcmodel=medany")
    flash, ram = Memory(0x80000000, 4 * MIB), Memory(0x80400000, 8 * MIB)
    tools = "riscv64-unknown-elf-"
    return Target(f"riscv{bits}", text, tools, flags, flash, ram, emulator, _RISCV, clock)


TARGETS = {
    target.name: target
    for target in (
        _arm(
            "cortex-m7",
            "Arm Cortex-M7, doubles in hardware",
            "mps2-an500",
            ("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
            400e6,
        ),
        _arm(
            "cortex-m4",
            "Arm Cortex-M4, doubles in software",
            "mps2-an386",
            ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", *SOFT_DOUBLES),
            100e6,
        ),
        _riscv(32, "RISC-V RV32GC, doubles in hardware", "ilp32d", 100e6),
        _riscv(64, "RISC-V RV64GC, doubles in hardware", "lp64d", 100e6),
    )
}


def find_target(name: str) -> Target:
    """The processor of that name, with its tools at hand; UsageError that says what is missing."""
    if name not in TARGETS:
        known = ", ".join(TARGETS)
        raise UsageError(
            f"{name}: there is no such processor{did_you_mean(name, TARGETS)}; {known}"
        )
    if lacking := missing(TARGETS[name]):
        raise UsageError(lacking)
    return TARGETS[name]


def missing(target: Target) -> str:
    """What a machine lacks for a processor, as one line; "" if it lacks nothing."""
    tools = (target.compiler, f"{target.tools}objcopy", target.emulator[0])
    lacking = [tool for tool in tools if shutil.which(tool) is None]
    if target.compiler not in lacking and not _has_library(target):
        lacking.append(f"picolibc of {target.compiler}")
    if not lacking:
        return ""
    packages = " ".join(target.packages)
    return f"{target.name} needs {' and '.join(lacking)}: make pil, or apt-get install {packages}"


@cache
def _has_library(target: Target) -> bool:
    """A gcc that does not find its specs gives their name back."""
    command = [target.compiler, f"-print-file-name={SPECS}"]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    return found != SPECS
