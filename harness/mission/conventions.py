# SPDX-License-Identifier: BSD-2-Clause
"""Names by which the engine recognises what components of a mission mean: bodies in orbit, start
states, and examples of what may take the place of a component.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from harness.results.result import Result


class Bodies(NamedTuple):
    """Names of the variables of a body, `{}` standing for its letter, and of the parameters of its
    start, all without the component.

    position [m], velocity [m/s], attitude: relative to an inertial frame; components: those that
    are bodies, in their order; start: position [m] and velocity [m/s]; semi_major_axis: 0 where
    these two count; elements: the other five of an orbit, eccentricity, inclination, argument of
    perigee, right ascension and true anomaly [rad]; field: of gravity [m3/s2]; beside: position and
    velocity relative to another body in its Hill frame; sun: parameter of whatever must know where
    the Sun is, a unit vector in the inertial frame ("": nothing does).
    """

    position: str
    velocity: str
    attitude: str
    components: tuple[str, ...]
    start: tuple[str, str]
    semi_major_axis: str
    elements: tuple[str, str, str, str, str]
    field: str
    beside: tuple[str, str]
    sun: str = ""

    def found(self, result: Result) -> dict[str, str]:
        """Letters of the components that have a position, in the order of the result."""
        before, after = map(re.escape, self.position.split("{}"))
        pattern = re.compile(rf"(\w+)\.{before}([A-Z]){after}")
        return {match[1]: match[2] for n in result.vectors if (match := pattern.fullmatch(n))}


class Example(NamedTuple):
    """A source that flies in the place of a component: where, the inputs that it needs, the outputs
    that it has, its file without ending in the folder of examples, and what whoever changes it must
    know.
    """

    place: str
    inputs: frozenset[str]
    outputs: frozenset[str]
    file: Path
    note: str = ""
