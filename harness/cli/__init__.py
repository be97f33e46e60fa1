# SPDX-License-Identifier: BSD-2-Clause
"""Command line: options, calls and printing, nothing else."""

import gc
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status. From here on Ctrl-C prints one line, even
    during the remaining imports.
    """
    gc.set_threshold(50_000)  # imports leave no garbage: 150 collections take a tenth of the start
    try:
        from harness.cli import app
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 1
    return app.main(arguments)
