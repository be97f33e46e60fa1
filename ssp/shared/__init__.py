# SPDX-License-Identifier: BSD-2-Clause
"""Parts shared by several missions: relative motion, estimates, safety, their figures, metrics and
replay.
"""
