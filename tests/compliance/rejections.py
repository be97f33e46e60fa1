# SPDX-License-Identifier: BSD-2-Clause
"""Checks of rejections: a message that states the function and the reason, and an instance that is
unchanged and usable.
"""

from __future__ import annotations

import re
from contextlib import contextmanager

from tests.compliance.api import Status
from tests.compliance.probe import Instance


@contextmanager
def rejected(instance, function, *words):
    """Check that `function` rejects the call inside with one message that has these words, and that
    nothing changes.
    """
    before, host = instance.snapshot(), instance.host
    host.messages.clear()
    answer = []
    yield answer
    assert answer == [Status.ERROR]
    (message,) = host.errors
    assert message.startswith(f"{function}: ")
    assert [word for word in words if word not in message] == []
    assert_readable(message)
    assert instance.snapshot() == before


def assert_readable(message):
    """Check that a message has no sign of a NaN or of a zero, which is meaningless."""
    assert not re.search(r"-nan|nan\(|-0(?![.\d])", message), message


def assert_usable(instance):
    """Check that it continues from t = 0.5 s with the bits of an instance that has never rejected a
    call.
    """
    with Instance(instance.fmu) as other:
        other.start()
        other.simulate(5)
        assert instance.simulate(5, first=5) == other.simulate(5, first=5)
