# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of a result with the claims of papers: verdicts on the claims, deviations of the run
from the cases of the paper, and the report as text.
"""
