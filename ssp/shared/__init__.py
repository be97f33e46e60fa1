# SPDX-License-Identifier: BSD-2-Clause
"""What several missions have in common: relative motion, estimates, safety, their figures,
measures and replay.
"""
