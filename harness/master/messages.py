# SPDX-License-Identifier: BSD-2-Clause
"""Log messages that FMUs send by the logger callback of FMI, and the note that names the present
FMI call, for the error message if the process ends in this call.

FMPy formats the messages of FMI 2.0, which have variadic arguments, in a small C library. This
library can call only one Python function per process, so the messages of all instances arrive at
one function here, and the message about a failed call is fetched right after the call.

An FMU of the project rejects parameters in such a message: `mass_0 = -5: must be > 0`. One message
contains all rejections, in the format of fmus/core/adapter/fmu.h. The name may be a whole vector or
matrix (`J_S`), or an expression of several parameters (`|q_KS|`, `range.lambda * range.beta`). The
rule may name other parameters (`must be below rho2`).
"""

from __future__ import annotations

import ctypes
import logging
import re
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from fmpy import calloc, free
from fmpy.fmi2 import (
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import fmi3LogMessageCallback
from fmpy.logging import addLoggerProxy
from numpy.typing import NDArray

from harness.errors import HarnessError, RejectedValueError, UsageError
from harness.system.values import base

WARNING, DISCARD = 1, 2
"""Values of fmi2Status. Messages of status DISCARD and above explain why a call has failed."""

STATISTICS = "logStatistics"
"""Log category of link FMUs for the cost of the steps of a component on its processor."""

_log = logging.getLogger("harness")
_errors: deque[tuple[str, str]] = deque(maxlen=20)
_warnings: dict[str, tuple[int, str]] = {}


def _receive(instance: bytes | None, status: int, category: bytes | None, message: Any) -> None:
    """Store a message of an instance: take_error() returns errors, report_warnings() logs
    warnings. Log a message of the category STATISTICS at once.
    """
    name, text = _text(instance), " ".join(_text(message).split())
    if status >= DISCARD:
        _errors.append((name, text))
    elif status == WARNING:
        count, _ = _warnings.get(name, (0, ""))
        _warnings[name] = count + 1, text
    elif category == STATISTICS.encode():
        _log.warning("%s: %s", name, text)


def _text(raw: bytes | None) -> str:
    return (raw or b"").decode("utf-8", errors="replace")


_logger = fmi2CallbackLoggerTYPE(lambda _environment, *message: _receive(*message))
_allocate = fmi2CallbackAllocateMemoryTYPE(calloc)
_free = fmi2CallbackFreeMemoryTYPE(free)


def callbacks() -> ctypes.Structure:
    """Return the callback functions of FMI 2.0 for one instance. They store the messages of the
    instance in this module.
    """
    functions: ctypes.Structure = fmi2CallbackFunctions()
    functions.logger, functions.allocateMemory, functions.freeMemory = _logger, _allocate, _free
    addLoggerProxy(ctypes.byref(functions))
    return functions


def logger(instance: str) -> Any:
    """Return the FMI 3.0 callback that stores the messages of one instance in this module."""
    name = instance.encode()
    return fmi3LogMessageCallback(lambda _environment, *message: _receive(name, *message))


def take_error(instance: str) -> str | None:
    """Return the newest error message of an instance, or a message that names no instance if it is
    newer; None if there is none. All stored error messages are removed.
    """
    candidates = [text for name, text in _errors if name in (instance, "")]
    _errors.clear()
    return candidates[-1] if candidates else None


def report_warnings(instance: str) -> None:
    """Log in one line the number of warnings that an instance has sent and the last warning, then
    forget all of them.
    """
    count, last = _warnings.pop(instance, (0, ""))
    if count:
        several = "s" * (count > 1)
        _log.warning("%s: %d warning%s, the last: %s", instance, count, several, last)


def forget(instance: str) -> None:
    """Remove the stored warnings of an earlier instance with this name, and the stored errors of
    all instances.
    """
    _warnings.pop(instance, None)
    take_error(instance)


# ---- the present FMI call, in memory that the parent can read if the process ends in this call
# (during macro steps the executors store only the index of the call, which costs less)

NOTE_SIZE = 400
"""Number of bytes of a note: name of the instance, a zero byte, name of the function."""

Note = NDArray[np.uint8]

_note: Note = np.zeros(NOTE_SIZE, dtype=np.uint8)


def share_note(note: Note) -> None:
    """Use `note`, memory that is shared with another process, for all later notes."""
    global _note  # noqa: PLW0603 - one process makes one call at a time
    _note = note


def note_call(instance: str, call: str) -> None:
    """Write into the note that the FMI function `call` of an instance is about to be called."""
    _note[:] = _written(instance, call)


@lru_cache(maxsize=1024)
def _written(instance: str, call: str) -> Note:
    text = f"{instance[:200]}\0{call}".encode()[:NOTE_SIZE].ljust(NOTE_SIZE, b"\0")
    return np.frombuffer(text, dtype=np.uint8)


def noted_call(note: Note) -> tuple[str, str]:
    """Return instance and function of the last noted call; ("", "") if none is noted."""
    instance, _, call = note.tobytes().decode(errors="replace").partition("\0")
    return instance, call.rstrip("\0")


# ---- notes of the harness about several runs of one system: equal notes are logged once


class Notes(logging.Handler):
    """Log handler that passes the text of every note (warning) to the function `hear`."""

    def __init__(self, hear: Callable[[str], object]) -> None:
        super().__init__(logging.WARNING)
        self._hear = hear

    def emit(self, record: logging.LogRecord) -> None:
        """Pass the text of a log record to the function `hear` of the constructor."""
        self._hear(record.getMessage())


@contextmanager
def noted() -> Iterator[dict[str, None]]:
    """Collect the notes that the harness logs in the `with` block instead of logging them; yield a
    dictionary whose keys are their lines, each line once.
    """
    lines: dict[str, None] = {}
    before = _log.handlers, _log.propagate
    _log.handlers, _log.propagate = [Notes(lines.setdefault)], False
    try:
        yield lines
    finally:
        _log.handlers, _log.propagate = before


@contextmanager
def logged_once() -> Iterator[None]:
    """Delay the notes that the harness logs in the `with` block until its end, and log each line
    once.
    """
    lines: dict[str, None] = {}
    try:
        with noted() as lines:
            yield
    finally:
        for line in lines:
            _log.warning("%s", line)


# ---- rejected parameters


_ONE = r"([^;=]+) = (\S+): (.+?)"
_CALL = re.compile(r"fmi[23]\w+: ")
_ALL = re.compile(rf"{_ONE}(?:; {_ONE})*", re.DOTALL)
_EACH = re.compile(rf"{_ONE}(?:; (?=[^;=]+ = )|$)", re.DOTALL)
_NAME = re.compile(r"[^\W\d]\w*(?:\.\w+)*")
_ARTICLE = re.compile(r"\ba (?=[a-z])")
"""Regular expression of the article `a` before a word, which is removed from a rule, so that it is
not mistaken for a parameter named `a`.
"""


class Rejection(NamedTuple):
    """Rejected value with the name of its parameter or expression and the rule that it breaks, all
    three as the FMU writes them.
    """

    name: str
    value: str
    rule: str

    def __str__(self) -> str:
        return f"{self.name} = {self.value}: {self.rule}"

    def about(self, names: Iterable[str]) -> list[str]:
        """Return the parameters among `names` that occur in the name of the rejection. If there are
        none, return the parameters that occur in its rule.
        """
        known = list(names)
        return _among(known, self.name) or _among(known, _ARTICLE.sub("", self.rule))


def _among(names: Iterable[str], text: str) -> list[str]:
    """Return the parameters that a text is about: the one whose name equals `text`; if `text` is an
    element of a vector, the vector; else all whose names occur in `text` as words.
    """
    if text in (known := list(names)):
        return [text]
    whole, words = base(text), _NAME.findall(text)
    if whole != text:  # about an element, so not about the other elements of its vector
        return [name for name in known if name == whole]
    return [name for name in known if base(name) in words]


def rejections(message: str, parameters: Collection[str]) -> tuple[Rejection, ...]:
    """Return the rejections in an error message of an FMU; () if the message has another form, or
    one of its rejections is about none of these parameters.

    parameters: names of scalar variables, or of whole vectors and matrices.
    """
    text = _CALL.sub("", message, count=1)
    if not _ALL.fullmatch(text):
        return ()
    found = tuple(Rejection(*each) for each in _EACH.findall(text))
    known = {*parameters, *map(base, parameters)}
    return found if all(_among(known, rejection.name) for rejection in found) else ()


def as_typed(error: RejectedValueError, given: Mapping[str, Any], prefix: str) -> HarnessError:
    """Return a UsageError about the options --set that the user typed, if all rejections are about
    values of these options; else return the error unchanged.

    given: values of --set by name `component.parameter`; prefix: `component.` of the failed
    component.
    """
    names = [name.removeprefix(prefix) for name in given if name.startswith(prefix)]
    lines = []
    for rejection in error.rejections:
        if not (typed := rejection.about(names)):
            return error
        values = " ".join(f"--set {prefix}{name}={given[prefix + name]}" for name in typed)
        lines.append(f"{values}: {_rule_text(rejection, typed)}")
    return UsageError("\n".join(lines))


def without(error: RejectedValueError, names: Collection[str]) -> RejectedValueError | None:
    """Return the error without the rejections of these parameters (`component.parameter`); None if
    no rejection remains.
    """
    prefix = f"{error.component}."
    inner = [name.removeprefix(prefix) for name in names if name.startswith(prefix)]
    left = tuple(rejection for rejection in error.rejections if not rejection.about(inner))
    return RejectedValueError(error.component, error.time, left) if left else None


def _rule_text(rejection: Rejection, typed: Collection[str]) -> str:
    """Return the rule of a rejection as it follows the options --set in an error message.

    typed: parameters of these options. If the rejected name is one of them, the text is the rule
    alone, `must be > 0`; if it is an element of one, name and rule, `K_rho[2] must be >= 0`; for
    any other name, such as an expression, name, value and rule.
    """
    if rejection.name in typed:
        return rejection.rule
    if base(rejection.name) in typed:
        return f"{rejection.name} {rejection.rule}"
    return f"{rejection.name} = {rejection.value} {rejection.rule}"
