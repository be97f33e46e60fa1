# SPDX-License-Identifier: BSD-2-Clause
"""Memory that two processes share, as numpy arrays; it goes when both have let go of it."""

from __future__ import annotations

import mmap
import multiprocessing
import sys
from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from harness.errors import UsageError

FORK = sys.platform == "linux"
"""Whether children are forks, which begin at once; elsewhere they are fresh interpreters."""

Block = Any
"""Shared bytes that can be handed to a child."""


def context() -> Any:
    """How children are made."""
    return multiprocessing.get_context("fork" if FORK else "spawn")


def block(size: int) -> Block:
    """So many zero bytes; UsageError if there is no room."""
    try:
        return mmap.mmap(-1, max(size, 1)) if FORK else RawArray("b", size)
    except (OSError, ValueError, OverflowError, MemoryError) as error:
        raise UsageError(
            f"{size} bytes of results do not fit into memory: record fewer with --every"
        ) from error


def array(shared: Block, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """The bytes as an array."""
    count = int(np.prod(shape))
    return np.frombuffer(shared, dtype=dtype, count=count).reshape(shape)
