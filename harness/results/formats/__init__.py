# SPDX-License-Identifier: BSD-2-Clause
"""One module per kind of results file, each with write(result, path) and read(path).

They raise what the libraries behind them raise; harness/results/files.py says it in one line.
"""
