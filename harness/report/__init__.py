# SPDX-License-Identifier: BSD-2-Clause
"""Self-contained HTML page for a result, a comparison or a campaign.

The input is a result, and the figures, claims and metrics that its mission defines. The output is a
page that opens in any browser without a network, with the settings of the run, values, verdicts,
linked plots and a three-dimensional replay. Python selects the values and thins the curves, and the
scripts in `page/` draw them. Every statement about a run comes from the descriptions, units, claims
and parameters of the system and its mission, not from this package.
"""
