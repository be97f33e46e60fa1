# SPDX-License-Identifier: BSD-2-Clause
"""Formats of results files, one module per kind with write(result, path) and read(path). They raise
the errors of their libraries, and harness/results/files.py reports each error in one line.
"""
