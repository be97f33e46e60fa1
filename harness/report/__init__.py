# SPDX-License-Identifier: BSD-2-Clause
"""One self-contained HTML page from a result, a comparison or a campaign.

Input: a result, and the tables of figures, claims and metrics that fit it. Output: a page that
opens anywhere without a network, with the settings of the run, numbers, verdicts, linked plots and
a replay in space. Python selects and thins the numbers, and the scripts in `page/` draw them. Every
statement about a run comes from descriptions, units, claims and parameters, not from this package.
"""
