# SPDX-License-Identifier: BSD-2-Clause
"""Children that hear Ctrl-C also where the tests themselves do not (`make test &`, nohup): a
process inherits that a signal is ignored.
"""

import signal
import subprocess
from typing import Any


def start(command: list[str], **options: Any) -> "subprocess.Popen[Any]":
    """As subprocess.Popen, with the default answer to SIGINT in the child."""
    inherited = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(command, **options)
    finally:
        signal.signal(signal.SIGINT, inherited)
