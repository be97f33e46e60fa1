# SPDX-License-Identifier: BSD-2-Clause
"""Libraries that tests compile from C, each once for all workers and all later runs: they are
stored under `build/tests` by the hash of their sources and compiler.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from hashlib import sha256
from pathlib import Path

CACHE = Path(__file__).parents[1] / "build" / "tests"


def compiled(source: Path, library: Path, *flags: str, compiler: str = "gcc") -> Path:
    """A library of one source, which includes nothing of the project."""
    program = shutil.which(compiler) or compiler
    version = Path(program).stat().st_mtime_ns if Path(program).exists() else 0
    about = repr((program, version, source.name, flags)).encode()
    cached = CACHE / f"{sha256(about + source.read_bytes()).hexdigest()}{library.suffix}"
    if not cached.exists():
        CACHE.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=CACHE) as folder:  # its name comes when it is whole
            made = Path(folder) / library.name
            subprocess.run(
                [program, "-shared", "-fPIC", *flags, source, "-o", made, "-lm"], check=True
            )
            made.replace(cached)
    shutil.copyfile(cached, library)
    return library
