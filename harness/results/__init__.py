# SPDX-License-Identifier: BSD-2-Clause
"""Results of runs: tables of recorded rows with names and units, the files that store them, and
quantities derived from them, such as metrics and margins of requirements.

This package imports neither the master, which produces results, nor the modules of figures and
claims, which read results.
"""
