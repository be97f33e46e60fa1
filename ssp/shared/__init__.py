# SPDX-License-Identifier: BSD-2-Clause
"""Code shared by several missions: relative motion, estimates and safety, with their figures,
metrics and replay.
"""
