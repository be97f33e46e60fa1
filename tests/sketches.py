# SPDX-License-Identifier: BSD-2-Clause
"""Pictures without their layout and of few pixels, where a test is not about how they look."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from matplotlib import rc_context

from harness.figures import plots, style
from harness.report import campaign


@contextmanager
def sketched() -> Iterator[None]:
    """Within the block pictures are sketches."""

    def save(canvas: Any, path: Path) -> Path:
        canvas.set_layout_engine("none")
        with rc_context({"savefig.dpi": 20}):
            return style.save(canvas, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "save", save)
        patch.setattr(campaign, "save", save)
        yield
