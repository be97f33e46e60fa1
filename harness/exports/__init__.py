# SPDX-License-Identifier: BSD-2-Clause
"""Exports of a system for other tools: one .ssp, one container FMU, an N2 diagram."""
