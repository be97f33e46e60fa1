# SPDX-License-Identifier: BSD-2-Clause
"""Evaluation of the claims of papers by a result: verdicts on the claims, deviations of the run
from the cases of the paper, and the report as text.
"""
