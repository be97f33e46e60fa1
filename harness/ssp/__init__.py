# SPDX-License-Identifier: BSD-2-Clause
"""SSP files: the only place that knows XML.

What enters: an .ssp of ours or of another tool, or a TOML of the project. What leaves: a System
(reader), or an .ssp in the dialect that every tool accepts (writer, build). No FMI call is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.system.model import System

read_starts: Callable[[System], tuple[Mapping[str, Any], str]]
"""Values of parameters by name and the UTC of t = 0 that `[start]` of a system gives; HarnessError.
Who reads files of other tools stands above, in harness.exchange, and is put here by harness itself.
"""
