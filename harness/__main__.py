# SPDX-License-Identifier: BSD-2-Clause
"""Entry point of `python -m harness`, which is the command `harness`."""

import sys

from harness.cli import main

if __name__ == "__main__":
    sys.exit(main())
