# SPDX-License-Identifier: BSD-2-Clause
"""A small system of third-party FMUs that runs for 6 s; with the parameter set `hot` one of them
fails at 3 s.
"""

TOML = """
name = "demo"
[experiment]
stop = 6.0
step = 1.0
[components]
count = "counter"
twice = "gain"
bad = "failing"
[connections]
"twice.u" = "count.n"
[parameters.bad]
t_fail = 100.0
[sets.hot]
description = "fails at 3 s"
[sets.hot.bad]
t_fail = 3.0
"""
