# SPDX-License-Identifier: BSD-2-Clause
"""Numbers by others: published cases flown through the FMUs, and how far our answer is from theirs.

What enters is data alone (cases/*.json: parameters, expected rows, tolerance, source and licence
beside each number, models that are wrong on purpose). What leaves is one row per case and quantity.
A folder of its own because nothing here may be computed by what it judges.
"""
