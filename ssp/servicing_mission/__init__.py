# SPDX-License-Identifier: BSD-2-Clause
"""Servicing mission from a range of 500 m to capture and a stack (servicer and target) at rest."""
