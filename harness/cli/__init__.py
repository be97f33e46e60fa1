# SPDX-License-Identifier: BSD-2-Clause
"""The command line: options, calls and printing, nothing else."""

from harness.cli.app import main

__all__ = ["main"]
