# SPDX-License-Identifier: BSD-2-Clause
"""`python -m tests.bench SYSTEM`: what a macro step costs, side by side with other masters."""

from __future__ import annotations

import sys

from harness.mission.library import campaigns
from tests.bench import environments, lanes, startup
from tests.bench.bench import bench

(system,) = sys.argv[1:2] or ["sync_approach"]
print(bench(system))
print("\n".join(environments.bench(system)))
if f"{system}_dispersions" in campaigns():
    print("\n".join(lanes.bench(system)))
print("\n".join(startup.bench(system)))
