# SPDX-License-Identifier: BSD-2-Clause
"""Contents of all missions of the project, for tests that check each of them."""

from __future__ import annotations

from harness.mission.library import everything

FIGURES = everything().figures
OVERLAYS = everything().overlays
PAPERS = everything().claims
METRICS = everything().metrics
