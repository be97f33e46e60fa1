# SPDX-License-Identifier: BSD-2-Clause
"""Folders of one run of the tests, the same for all its workers."""

from __future__ import annotations

import os
from pathlib import Path

from pytest import TempPathFactory


def shared(factory: TempPathFactory, name: str) -> Path:
    """A folder for what costs much and may be used by many processes at once."""
    base = factory.getbasetemp()  # for a worker of pytest-xdist it is inside the folder of the run
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / f"shared_{name}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder
