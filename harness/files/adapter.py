# SPDX-License-Identifier: BSD-2-Clause
"""Adapter of FMI, compiled once per compiler: every FMU that is built here links the same files."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from harness.files import cache, paths


def options(compiler: Sequence[str], fmi: int) -> list[str]:
    """Return the options with which build_fmu.py and fuse.py link the compiled adapter of a version
    of FMI instead of compiling it; none if that is impossible, if nothing is cached, or if the
    compiler has arguments, which may name files.
    """
    core, program = paths.core(), shutil.which(compiler[0])
    if not (core and program and cache.folder()) or len(compiler) > 1:
        return []
    sources = [*sorted(core.rglob("*.[ch]")), core / "build" / "build_fmu.py"]
    about = repr((fmi, program, paths.stamp(Path(program).resolve()))).encode()
    key = b"\0".join([about, *(source.read_bytes() for source in sources)])

    def make(folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        tool = [sys.executable, str(sources[-1]), f"--fmi={fmi}", f"--cc={program}"]
        subprocess.run([*tool, "--adapter", str(folder)], check=True, capture_output=True)

    try:
        return ["--adapter", str(cache.made("adapter", key, make))]
    except subprocess.CalledProcessError:  # the build itself prints why
        return []
