# SPDX-License-Identifier: BSD-2-Clause
"""Command line `harness`: parses options, calls the other packages and prints their results."""

import gc
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status. Ctrl-C prints one line instead of a
    traceback, even while modules are still being imported.
    """
    gc.set_threshold(50_000)  # avoids 150 garbage collections during imports, which free nothing
    try:
        from harness.cli import app
    except KeyboardInterrupt:
        print("harness: interrupted", file=sys.stderr)
        return 1
    return app.main(arguments)
