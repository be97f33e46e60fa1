# SPDX-License-Identifier: BSD-2-Clause
"""One statement about many things is one test: it is called for every one of them and lists all
that break it.

    @pytest.fixture
    def rng():
        return Each(range(20)).map(np.random.default_rng)

A fixture that returns an `Each` represents one value after the other; a fixture that depends on it
maps it. A test with two of them is called for every pair. What would be `pytest.mark.parametrize`
is `each` where the calls may share their fixtures:

    @each("axis", range(3))
    def test_it_turns_about(axis): ...
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack
from functools import wraps
from inspect import signature
from itertools import product
from operator import itemgetter
from typing import Any

import pytest


def some(values: Iterable[Any], every: int, first: int = 0) -> list[Any]:
    """Parameters of which every n-th runs in `make test`, and all in `make test-long`."""
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=() if k % every == first else pytest.mark.long,
        )
        for k, value in enumerate(values)
    ]


class Each:
    """Values, each of them made anew for every call."""

    def __init__(self, values: Iterable[Any], ident: Callable[[Any], str] = str) -> None:
        self.values, self.ident, self.source = tuple(values), ident, self
        assert self.values, "a test of each of nothing would pass"

    def map(self, make: Callable[[Any], Any]) -> Each:
        """Return an Each of `make(value)`."""
        return _Made(self, lambda value, stack: make(value))

    def within(self, context: Callable[[Any], AbstractContextManager]) -> Each:
        """Return an Each of `context(value)`, entered for one call."""
        return _Made(self, lambda value, stack: stack.enter_context(context(value)))

    def made(self, chosen: dict[Each, Any], stack: ExitStack) -> Any:
        return chosen[self]


def each(names: str | tuple[str, ...], values: Iterable[Any]) -> Callable[[Callable], Callable]:
    """A test that is called for one value, or tuple of values, after the other."""
    listed = names.split(", ") if isinstance(names, str) else list(names)
    source = Each(values, ascii)

    def decorated(test: Callable) -> Callable:
        @wraps(test)
        def called(**given: Any) -> None:
            if len(listed) == 1:
                call_for_each(test, given | {listed[0]: source})
            else:
                parts = {name: source.map(itemgetter(k)) for k, name in enumerate(listed)}
                call_for_each(test, given | parts)

        sought = signature(test)
        retained = [p for name, p in sought.parameters.items() if name not in listed]
        called.__signature__ = sought.replace(parameters=retained)  # type: ignore[attr-defined]
        return called

    return decorated


class _Made(Each):
    def __init__(self, origin: Each, make: Callable[[Any, ExitStack], Any]) -> None:
        self.origin, self.make, self.source = origin, make, origin.source

    def made(self, chosen: dict[Each, Any], stack: ExitStack) -> Any:
        if self not in chosen:
            chosen[self] = self.make(self.origin.made(chosen, stack), stack)
        return chosen[self]


def call_for_each(test: Callable, given: Mapping[str, Any], most: int = 0) -> None:
    """Calls the test for all combinations of the values, or until so many calls have failed.

    Raises
    ------
    BaseExceptionGroup
        of all failures, each with a note for which value.
    pytest.skip.Exception
        if every call was skipped, with all reasons.
    """
    sources = list(dict.fromkeys(x.source for x in given.values() if isinstance(x, Each)))
    combinations = list(product(*(source.values for source in sources)))
    wrong, failed, skipped = [], [], []
    for values in combinations:
        chosen = dict(zip(sources, values, strict=True))
        names = [source.ident(value) for source, value in chosen.items()]
        try:
            with ExitStack() as stack:
                test(**{n: _value(x, chosen, stack) for n, x in given.items()})
        except pytest.skip.Exception as reason:
            skipped.append(str(reason))
        except (Exception, pytest.fail.Exception) as error:
            error.add_note(f"for {', '.join(names)}")
            wrong.append(error)
            failed.append(" ".join(names))
            if len(failed) == most:
                break
    if wrong:
        raise BaseExceptionGroup(f"{len(wrong)} of {len(combinations)}: {', '.join(failed)}", wrong)
    if len(skipped) == len(combinations):
        pytest.skip("; ".join(sorted(set(skipped))))


def _value(x: Any, chosen: dict[Each, Any], stack: ExitStack) -> Any:
    return x.made(chosen, stack) if isinstance(x, Each) else x
