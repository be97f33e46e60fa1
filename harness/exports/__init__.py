# SPDX-License-Identifier: BSD-2-Clause
"""A system for others: one .ssp, one container FMU, an N2 diagram."""
