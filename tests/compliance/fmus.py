# SPDX-License-Identifier: BSD-2-Clause
"""The FMUs under test: every archive in the folder fmus/ of the build, found when the tests are
collected.

The environment variable SERVICING_FMUS_BUILD names another build folder, relative to the
repository.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / os.environ.get("SERVICING_FMUS_BUILD", "build")
ARCHIVES = sorted((BUILD / "fmus").glob("*.fmu"))

if not ARCHIVES:  # pytest would skip tests that are parametrised over nothing
    raise pytest.UsageError(f"there are no FMUs in {BUILD / 'fmus'}: build them first (make build)")
