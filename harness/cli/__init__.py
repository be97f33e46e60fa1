"""The command line: options, calls and printing, nothing else."""

from harness.cli.app import main

__all__ = ["main"]
