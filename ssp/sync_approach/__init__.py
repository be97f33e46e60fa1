# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Zhu & Yang 2009: synchronised approach to a tumbling target, adaptive control."""
