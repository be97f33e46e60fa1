# SPDX-License-Identifier: BSD-2-Clause
"""FMI adapter: the C code between the FMI functions and a model. It is compiled once per compiler
and FMI version, and every FMU that is built here is linked with the same object files.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from harness.files import cache, paths


def options(compiler: Sequence[str], fmi: int) -> list[str]:
    """Return the options with which build_fmu.py and fuse.py link an adapter from the cache instead
    of compiling it again; fmi: 2 or 3. The adapter is compiled first if the cache has none.

    Returns [] if the cache is off, the compiler or the C sources are missing, the adapter does not
    compile, or the compiler has arguments that do not begin with -m: these may name files, whose
    changes the cache would not notice.
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
    except subprocess.CalledProcessError:  # the build of the FMU will fail too, and print why
        return []
