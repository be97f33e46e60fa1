# SPDX-License-Identifier: BSD-2-Clause
"""Give a system to an optimiser of one's own as a black box. It searches for an initial attitude of
the servicer and rates of the target with which the law of the paper misses the attitude at the
grasp.

python examples/falsify.py
"""

import numpy as np
from scipy.optimize import minimize

from harness import Evaluator

CAMPAIGN = {
    "system": "sync_approach",
    "fixed": {"set": {"monitor.passive_time": 0}},
    "factors": {
        "servicer.sigma_SN_0": {"normal": {"mean": [0.2, -0.2, 0.15], "sigma": 0.02}},
        "target.omega_TN_T_0": {"normal": {"mean": [0.002, 0.01, 0.0], "sigma": 0.001}},
    },
}
runs = []
with Evaluator(CAMPAIGN, workers=1) as evaluator:
    attitude = evaluator.names.index("attitude")

    def margin(z):
        """Return the distance to failing; the search ends at the first failure."""
        runs.append(float(evaluator(z[np.newaxis])[0, attitude]))
        if runs[-1] < 0:
            raise StopIteration
        return runs[-1]

    try:
        minimize(margin, np.zeros(evaluator.d), method="Nelder-Mead", options={"maxfev": 50})
    except StopIteration:
        print(f"violated after {len(runs)} run(s) by {np.degrees(-runs[-1]):.1f} deg")
