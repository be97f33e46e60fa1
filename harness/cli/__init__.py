# SPDX-License-Identifier: BSD-2-Clause
"""Command line: options, calls and printing, nothing else."""

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status. From here on Ctrl-C prints one line, even
    during the remaining imports.
    """
    try:
        from harness.cli import app
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 1
    return app.main(arguments)
