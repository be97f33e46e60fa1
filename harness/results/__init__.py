# SPDX-License-Identifier: BSD-2-Clause
"""What a run leaves behind: a table with names and units, its files, and quantities derived from
it.

Results know nothing of the master that made them or of the figures and claims that read them.
"""
