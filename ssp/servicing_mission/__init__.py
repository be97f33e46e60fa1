# SPDX-License-Identifier: BSD-2-Clause
"""Servicing mission from 500 m to a stack at rest."""
