# SPDX-License-Identifier: BSD-2-Clause
"""What all missions of the project offer, for tests that look through all of it."""

from __future__ import annotations

from harness.mission.library import everything

FIGURES = everything().figures
OVERLAYS = everything().overlays
PAPERS = everything().claims
MEASURES = everything().measures
