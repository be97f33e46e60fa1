# SPDX-License-Identifier: BSD-2-Clause
"""Published reference values: published cases simulated with the FMUs, and the difference between
our values and theirs.

Only data enters (cases/*.json: parameters, expected rows, tolerance, source and licence beside each
number, deliberately wrong models). One row per case and quantity leaves. The folder is separate
because nothing here may be computed by the code under test.
"""
