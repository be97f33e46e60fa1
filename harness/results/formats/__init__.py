# SPDX-License-Identifier: BSD-2-Clause
"""Formats of results files, one module per format with write(result, path) and read(path). These
functions raise the errors of their libraries, and harness/results/files.py reports each error in
one line.
"""
