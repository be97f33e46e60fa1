# SPDX-License-Identifier: BSD-2-Clause
"""`python -m tests.bench SYSTEM`: what a macro step costs, side by side with other masters."""

from __future__ import annotations

import sys

from tests.bench import environments, startup
from tests.bench.bench import bench

(system,) = sys.argv[1:2] or ["sync_approach"]
print(bench(system))
print("\n".join(environments.bench(system)))
print("\n".join(startup.bench(system)))
