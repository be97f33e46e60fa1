# SPDX-License-Identifier: BSD-2-Clause
"""Scheduler and worker classes of Dask without the HTTP servers that Dask opens by default."""

from __future__ import annotations

from typing import Any

import distributed


class _WithoutPages:
    """Node of a Dask cluster without an HTTP server."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Disable the HTTP server, for which Dask has no setting."""


class Scheduler(_WithoutPages, distributed.Scheduler):
    """Scheduler of Dask without web pages."""


class Worker(_WithoutPages, distributed.Worker):
    """Worker of Dask without web pages."""
