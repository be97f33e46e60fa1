# SPDX-License-Identifier: BSD-2-Clause
"""Adapter of FMI, compiled once per compiler: every FMU that is built here links the same files."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from harness.files import cache, paths


def options(compiler: Sequence[str], fmi: int) -> list[str]:
    """Return the options with which build_fmu.py and fuse.py link the compiled adapter of a version
    of FMI instead of compiling it; none if that is impossible, if nothing is cached, or if the
    compiler has arguments other than for a processor, which may name files.
    """
    core, program = paths.core(), shutil.which(compiler[0])
    may_name_files = any(not argument.startswith("-m") for argument in compiler[1:])
    if may_name_files or not (core and program and cache.folder()):
        return []
    sources = [*sorted(core.rglob("*.[ch]")), core / "build" / "build_fmu.py"]
    command = [program, *compiler[1:]]
    about = repr((fmi, command, paths.stamp(Path(program).resolve()))).encode()
    key = b"\0".join([about, *(source.read_bytes() for source in sources)])

    def make(folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        tool = [sys.executable, str(sources[-1]), f"--fmi={fmi}", f"--cc={shlex.join(command)}"]
        subprocess.run([*tool, "--adapter", str(folder)], check=True, capture_output=True)

    try:
        return ["--adapter", str(cache.made("adapter", key, make))]
    except subprocess.CalledProcessError:  # the build itself prints why
        return []
