# SPDX-License-Identifier: BSD-2-Clause
"""Zhu & Yang 2009: synchronised approach to a tumbling target, adaptive control."""
