# SPDX-License-Identifier: BSD-2-Clause
"""Runs per second of processor time of the example of V-BAR (package `vbar`, Python 3.12): one body
with three degrees of freedom, Clohessy-Wiltshire equations, a step of 10 s.

    PYTHON tests/bench/vbar_runs.py
"""

from time import process_time

from vbar import ApproachEnv, run_many
from vbar.agents.pd import PDAgent

RUNS = 50

run_many(ApproachEnv(), PDAgent(), seeds=range(2))
began = process_time()
run_many(ApproachEnv(), PDAgent(), seeds=range(RUNS))
print(RUNS / (process_time() - began))
