# SPDX-License-Identifier: BSD-2-Clause
"""Private temporary folders that do not outlive the process, whatever ends it.

Python removes a folder after an error or Ctrl-C. After a crash in an FMU's code or a kill nothing
of Python runs any more; then a guard removes it: a shell that waits at a pipe which closes with the
process. (Windows and machines without a shell have no such guard.)
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from harness.errors import ResultsError

_GUARD = 'IFS= read -r word; [ "$word" = done ] || rm -rf -- "$1"'


class PrivateFolder:
    """A new folder that only this user can read; a context manager that gives its path."""

    def __init__(self) -> None:
        try:
            self._folder = TemporaryDirectory(prefix="harness-")
        except OSError as error:
            raise ResultsError(
                f"{os.environ.get('TMPDIR', 'the temporary folder')}: no temporary files can be "
                f"made there ({error.strerror or error})"
            ) from error
        self.path = Path(self._folder.name)
        self._guard = _guard(self.path)

    def close(self) -> None:
        """Remove the folder with all that is in it."""
        self._folder.cleanup()
        if self._guard is not None:
            self._guard.communicate(b"done\n")
            self._guard = None

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _guard(folder: Path) -> subprocess.Popen[bytes] | None:
    """The process that removes the folder if we cannot; in a session of its own, so that Ctrl-C
    does not reach it.
    """
    if os.name != "posix":
        return None
    command = ["/bin/sh", "-c", _GUARD, "harness-guard", str(folder)]
    quiet = subprocess.DEVNULL
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=quiet,
            stderr=quiet,
            start_new_session=True,
            cwd="/",
        )
    except OSError:  # a machine without a shell
        return None
