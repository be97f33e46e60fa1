# SPDX-License-Identifier: BSD-2-Clause
"""Run two controllers in the same system, print one table, and look into the results.

python examples/compare_controllers.py
"""

import numpy as np

from harness import compare


def main() -> None:
    """Run both variants in worker processes, which do not import this file."""
    controllers = {"controller": ["ppc_controller", "theta_d_controller"]}
    comparison = compare("ppc_tracking", "comparison", swap=controllers, stop=60)
    print(comparison.text())

    # what the table does not say is in the results, by label
    for label, result in comparison.results.items():
        peak = np.abs(result["propulsion.F_S"]).max()
        print(f"{label}: at most {peak:.0f} N along an axis")


if __name__ == "__main__":
    main()
