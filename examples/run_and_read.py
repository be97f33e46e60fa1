# SPDX-License-Identifier: BSD-2-Clause
"""Run the synchronised approach, read its results and parameters, save and reload them.

python examples/run_and_read.py
"""

from pathlib import Path

import numpy as np

from harness import read, run
from harness.results.files import ResultFile

# 10 minutes of the approach with a heavier servicer; every tenth macro step (1 s) is recorded
result = run("sync_approach", set=["servicer.mass_0=120"], stop=600, every=10)

# names are component.variable; vectors are arrays with one row per recorded time
separation = result["servicer.r_SN_N"] - result["target.r_TN_N"]
distance = np.linalg.norm(separation, axis=1)
print(f"from {distance[0]:.2f} m to {distance[-1]:.2f} m in {result.time[-1]:.0f} s")

# the parameters that were in force, with their shapes
print("mass at the start", result.parameter("servicer.mass_0"), "kg")
print("moments of inertia", np.diag(result.parameter("servicer.J_S")), "kg m2")

# .nc (xarray) or .csv; both come back with the same numbers
file = Path("approach.nc")
ResultFile(file).write(result)
again = read(file)
print("unchanged:", np.array_equal(again["servicer.r_SN_N"], result["servicer.r_SN_N"]))
