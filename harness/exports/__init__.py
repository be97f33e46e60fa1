# SPDX-License-Identifier: BSD-2-Clause
"""Exports of a system for other tools: one .ssp, one FMU, an N2 diagram."""
