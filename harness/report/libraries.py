# SPDX-License-Identifier: BSD-2-Clause
"""The libraries that a page carries: Plotly draws the plots, and K3D brings three.js for the
replay. Their scripts are in their Python packages, of the extra `report`.
"""

from __future__ import annotations

import base64
import gzip
import importlib.util
from functools import cache
from pathlib import Path

from harness.errors import HarnessError

SCRIPTS = {
    "plotly": Path("package_data") / "plotly.min.js",
    "k3d": Path("static") / "standalone.js",
}
"""Script of a library in its package."""


@cache
def script(library: str) -> str:
    """Script of a library, compressed and as text; HarnessError naming the extra if it is not
    there.
    """
    found = importlib.util.find_spec(library)
    file = Path(found.origin).parent / SCRIPTS[library] if found and found.origin else None
    if file is None or not file.is_file():
        raise HarnessError(
            f"a report needs {library}: pip install 'servicing-fmus[report]' (or {library})"
        )
    return base64.b64encode(gzip.compress(file.read_bytes(), 4, mtime=0)).decode()


def available() -> bool:
    """Whether all libraries are installed."""
    return all(importlib.util.find_spec(library) for library in SCRIPTS)
