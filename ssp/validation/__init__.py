# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the FMUs with published reference values: published cases are simulated, and the
results are compared with the published ones.

Input: data only (cases/*.json: parameters, expected rows, tolerance, source and licence of each
number, wrong models that the comparison must detect). Output: one row per case and quantity. The
code is separate from the FMUs, because no expected value may be computed by the code under test.
"""
