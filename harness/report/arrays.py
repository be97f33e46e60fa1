# SPDX-License-Identifier: BSD-2-Clause
"""The numbers of a page: every array once, whoever draws it, in single precision."""

from __future__ import annotations

import base64
import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Arrays:
    """Arrays by short names, which curves and bodies refer to."""

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}
        self.content: dict[str, dict[str, Any]] = {}

    def keep(self, values: Any) -> str:
        """Name of an array of any shape; equal arrays have one name."""
        with np.errstate(over="ignore"):
            single = np.ascontiguousarray(values, dtype="<f4")
        data = single.tobytes()
        digest = hashlib.sha256(repr(single.shape).encode() + data).digest()
        if digest not in self._names:
            self._names[digest] = name = f"a{len(self._names)}"
            text = base64.b64encode(data).decode()
            self.content[name] = {"shape": list(single.shape), "data": text}
        return self._names[digest]

    def take(self, name: str) -> NDArray[np.float32]:
        """An array as the page will have it."""
        kept = self.content[name]
        flat = np.frombuffer(base64.b64decode(kept["data"]), dtype="<f4")
        return flat.reshape(kept["shape"])

    @property
    def size(self) -> int:
        """Characters of all arrays in the page."""
        return sum(len(kept["data"]) for kept in self.content.values())
