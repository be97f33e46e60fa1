# SPDX-License-Identifier: BSD-2-Clause
"""Dask's scheduler and worker without the HTTP servers that every one of them opens otherwise."""

from __future__ import annotations

from typing import Any

import distributed


class _WithoutPages:
    """A node that listens to its own kind only."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Listen to nobody; Dask has no setting for that."""


class Scheduler(_WithoutPages, distributed.Scheduler):
    """A scheduler without pages."""


class Worker(_WithoutPages, distributed.Worker):
    """A worker without pages."""
