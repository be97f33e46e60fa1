# SPDX-License-Identifier: BSD-2-Clause
"""The FMUs of FMI 3.0 under test, each with the one of FMI 2.0 of the same model."""

from __future__ import annotations

from tests.compliance.fmus import BUILD, TESTED

FOLDER = BUILD / "fmus3"
ARCHIVES = [FOLDER / path.name for path in TESTED]
"""One for every FMU of FMI 2.0."""
