# SPDX-License-Identifier: BSD-2-Clause
"""One self-contained page of HTML from a result, a comparison or a campaign.

A result comes in, with the tables of figures, claims and measures that fit it; a page leaves that
opens anywhere without a network: what was flown, numbers, verdicts, linked plots, a replay in
space. Python chooses and thins the numbers, the scripts in `page/` draw them; nothing that a page
says about a run is written here, it comes from descriptions, units, claims and parameters.
"""
