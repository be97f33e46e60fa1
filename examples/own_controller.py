# SPDX-License-Identifier: BSD-2-Clause
"""Build my_controller.c into an FMU and run it in place of the controller of a system.

python examples/own_controller.py
"""

from pathlib import Path

import numpy as np

from harness import build, run

fmu = build(Path(__file__).with_name("my_controller.c"), "my_controller.fmu")

result = run("sync_approach", swap={"controller": fmu}, set=["controller.K=20"], stop=600)

# a row holds what the software commanded one macro step before the states beside it
position = result["servicer.r_SN_N"] - result["target.r_TN_N"]
error = np.linalg.norm(position[:-1] - result["guidance.rho_ref_N"][1:], axis=1)
print(f"position error after 5 min: at most {1000 * error[3000:].max():.1f} mm")
