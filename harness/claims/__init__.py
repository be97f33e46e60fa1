# SPDX-License-Identifier: BSD-2-Clause
"""Evaluation of the claims of papers in a result: deviations from the run that a paper describes,
verdicts, and the report as text.
"""
