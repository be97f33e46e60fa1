# SPDX-License-Identifier: BSD-2-Clause
"""The pages of the site as .ci/pages writes them, without the figures of runs."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = (
    *("commands", "keys", "missions", "models", "papers", "python", "quoted", "results", "text"),
    "validation",
)


@pytest.fixture(scope="session")
def writer():
    """The modules of .ci/pages by name."""
    sys.path.insert(0, str(ROOT / ".ci/pages"))
    try:
        yield {name: importlib.import_module(name) for name in MODULES}
    finally:
        sys.path.remove(str(ROOT / ".ci/pages"))
        for name in [name for name in sys.modules if name.partition(".")[0] in MODULES]:
            sys.modules.pop(name)
