# SPDX-License-Identifier: BSD-2-Clause
"""The command line: options, calls and printing, nothing else."""

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status. Ctrl-C is one line from here on, while the rest is
    still being imported too.
    """
    try:
        from harness.cli import app
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 1
    return app.main(arguments)
