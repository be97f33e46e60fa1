# SPDX-License-Identifier: BSD-2-Clause
"""What a refusal must look like: a message that says who and why, and an instance that is as it was
and goes on.
"""

from __future__ import annotations

import re
from contextlib import contextmanager

from tests.compliance.api import Status
from tests.compliance.probe import Instance


@contextmanager
def refused(instance, function, *words):
    """What happens inside must be refused by `function` with one message that has these words, and
    change nothing.
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
    """No sign of a NaN or of a zero in it, which say nothing."""
    assert not re.search(r"-nan|nan\(|-0(?![.\d])", message), message


def assert_usable(instance):
    """Goes on from t = 0.5 s to the bits of an instance that has never met a refusal."""
    with Instance(instance.fmu) as other:
        other.start()
        other.fly(5)
        assert instance.fly(5, first=5) == other.fly(5, first=5)
