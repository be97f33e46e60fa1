# SPDX-License-Identifier: BSD-2-Clause
"""Give a system to PSY-TaLiRo as a black box. It searches for an initial attitude of the servicer
and rates of the target with which the law of the paper misses the attitude at the grasp.

pip install psy-taliro, then python examples/psy_taliro.py
"""

from staliro import TestOptions, costfunc, staliro
from staliro.optimizers import UniformRandom

from harness import load, run
from harness.results.requirements import margin

NAMES = ("servicer.sigma_SN_0", "target.omega_TN_T_0")
CENTRES = ((0.2, -0.2, 0.15), (0.002, 0.01, 0.0))
SPREADS = (0.02, 0.001)

with load("sync_approach") as system:
    ATTITUDE = system.requirements["attitude"]


@costfunc
def cost(inputs):
    """Return the margin of the requirement, which is the robustness of rtamt."""
    values = list(inputs.static.values())
    result = run("sync_approach", set=dict(zip(NAMES, (values[:3], values[3:]), strict=True)))
    return margin(result, ATTITUDE)


bounds = {
    f"{name}[{i + 1}]": (x - spread, x + spread)
    for name, centre, spread in zip(NAMES, CENTRES, SPREADS, strict=True)
    for i, x in enumerate(centre)
}
options = TestOptions(static_inputs=bounds, iterations=20, seed=1)
found = staliro(cost, UniformRandom(min_cost=0.0), options)
costs = [evaluation.cost for evaluation in found[0].evaluations]
print(f"violated after {len(costs)} run(s), margin {min(costs):.4f} rad")
