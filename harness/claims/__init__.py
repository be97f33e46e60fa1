# SPDX-License-Identifier: BSD-2-Clause
"""Claims of papers judged by a result: how it deviates from the run that a paper describes, the
verdicts, and the report as text.
"""
