# SPDX-License-Identifier: BSD-2-Clause
"""Write every system of a release a second time, as SSP 2.0 with FMUs of FMI 3.0: NAME.fmi3.ssp
beside NAME.ssp. The results of both files agree bit for bit.

python .ci/reference_systems.py dist        # make release
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from harness import load
from harness.ssp.writer import write_ssp

ENDING = ".fmi3.ssp"


def write(folder: Path) -> list[Path]:
    """Write a file for every system in ssp/, with FMUs from fmus3/, and return their paths."""
    written = []
    for path in sorted((folder / "ssp").glob("*.ssp")):
        if path.name.endswith(ENDING):
            continue
        with load(path) as system:
            fmus = [folder / "fmus3" / c.fmu.name for c in system.components]
            components = zip(system.components, fmus, strict=True)
            twin = replace(system, components=tuple(replace(c, fmu=fmu) for c, fmu in components))
            written.append(path.with_name(f"{path.stem}{ENDING}"))
            write_ssp(twin, written[-1])
    return written


if __name__ == "__main__":
    print(*write(Path(sys.argv[1])), sep="\n")
