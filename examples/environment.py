# SPDX-License-Identifier: BSD-2-Clause
"""Hold 10 m on the grasp axis of a slowly turning target with a hand-written policy.

python examples/environment.py
"""

import numpy as np

from harness import environment

env = environment(
    "sync_approach",
    observe=["guidance.rho_H", "guidance.rho_ref_H", "guidance.drho_H"],
    act=["controller.F_cmd_S"],
    params="limited",
    set={"guidance.rho_0": 10, "guidance.rho_M": 10, "target.omega_TN_T_0": [0, 0.002, 0],
         "servicer.sigma_SN_0": [-0.2, -0.0536, -0.7464], "servicer.rho_0_H": [0, 11, 0]},
    stop=600,
)  # fmt: skip
seen, _ = env.reset()
total, over = 0.0, False
while not over:  # spring and damper in Hill axes, commanded in servicer axes: 36 deg off at the end
    rho, reference, rate = seen.reshape(3, 3)
    force = np.clip(
        0.1 * (reference - rho) - 5.0 * rate, env.action_space.low, env.action_space.high
    )
    seen, reward, lost, out, info = env.step(force)
    total, over = total + reward, lost or out

error = env.result()["guidance.rho_H"] - env.result()["guidance.rho_ref_H"]
print(f"return {total:.3f}, position error at the end {np.linalg.norm(error[-1]):.2f} m")
for name, found in info["requirements"].items():
    print(f"{name}: {found.statement}")
