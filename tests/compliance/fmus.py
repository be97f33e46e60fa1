# SPDX-License-Identifier: BSD-2-Clause
"""The FMUs under test: every archive in the folder fmus/ of the build, found when the tests are
collected.

The environment variable SERVICING_FMUS_BUILD names another build folder, relative to the
repository; SERVICING_FMUS names the FMUs to test, between spaces, instead of all.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / os.environ.get("SERVICING_FMUS_BUILD", "build")
ARCHIVES = sorted((BUILD / "fmus").glob("*.fmu"))
CHOSEN = os.environ.get("SERVICING_FMUS", "").split()
TESTED = [path for path in ARCHIVES if not CHOSEN or path.stem in CHOSEN]

if not ARCHIVES:
    raise pytest.UsageError(f"there are no FMUs in {BUILD / 'fmus'}: build them first (make build)")
