# SPDX-License-Identifier: BSD-2-Clause
"""Private temporary folders that do not outlive the process, whatever ends it.

Python removes a folder after an error or Ctrl-C. After a crash in an FMU's code or a kill nothing
of Python runs any more; then a guard removes it: a shell that waits at a pipe which closes with the
process. (Windows and machines without a shell have no such guard.)
"""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
import tempfile
import weakref
from pathlib import Path
from typing import Any

from harness.errors import ResultsError

_GUARD = 'IFS= read -r word; [ "$word" = done ] || rm -rf -- "$1"'


class PrivateFolder:
    """A new folder that only this user can read; a context manager that gives its path.

    where: an existing folder, None: that of temporary files.
    """

    def __init__(self, where: Path | None = None) -> None:
        self._guard = None
        try:
            self.path = (where or Path(tempfile.gettempdir())) / f"harness-{secrets.token_hex(8)}"
            self._guard = _guard(self.path)  # first, so that no kill comes between
            self.path.mkdir(mode=0o700)
        except OSError as error:
            self._dismiss_guard()
            place = where or os.environ.get("TMPDIR", "the temporary folder")
            raise ResultsError(
                f"{place}: no temporary files can be made there ({error.strerror or error})"
            ) from error
        self._remove = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def close(self) -> None:
        """Remove the folder with all that is in it."""
        self._remove()
        self._dismiss_guard()

    def _dismiss_guard(self) -> None:
        if self._guard is not None:
            self._guard.communicate(b"done\n")
            self._guard = None

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.close()


def _guard(folder: Path) -> subprocess.Popen[bytes] | None:
    """The process that removes the folder if we cannot; in a session of its own, so that Ctrl-C
    does not reach it.
    """
    if os.name != "posix":
        return None
    command = ["/bin/sh", "-c", _GUARD, "harness-guard", str(folder)]
    quiet = subprocess.DEVNULL
    streams: Any = {"stdin": subprocess.PIPE, "stdout": quiet, "stderr": quiet}
    try:
        return subprocess.Popen(command, start_new_session=True, cwd="/", **streams)
    except OSError:  # a machine without a shell
        return None
