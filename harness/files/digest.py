# SPDX-License-Identifier: BSD-2-Clause
"""Hash of the content of a file, computed once as long as the file stays as it is."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, 64 hexadecimal digits; OSError if it cannot be read."""
    stamp = Path(path).stat()
    return _sha256(Path(path).absolute(), stamp.st_mtime_ns, stamp.st_size)


@lru_cache(maxsize=256)
def _sha256(path: Path, _modified: int, _size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
