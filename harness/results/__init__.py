# SPDX-License-Identifier: BSD-2-Clause
"""Results of a run: a table with names and units, its files, and derived quantities.

This package depends neither on the master that made a result nor on figures and claims that read
it.
"""
