# SPDX-License-Identifier: BSD-2-Clause
"""Terminals alone connect every system as its description does."""

from __future__ import annotations

import zipfile
from collections import defaultdict
from functools import cache

import pytest
from lxml import etree

from harness import load
from harness.files import paths
from harness.system.values import base
from tests.each import some

FILE = "terminalsAndIcons/terminalsAndIcons.xml"

VIRTUAL = {("TN_out", "close_guidance", "q_TN"), ("TN_out", "close_guidance", "omega_TN_T")}
"""The closing follows the attitude that the manager commands, to the place of the target."""

FORCE_ALONE = {("wrench_cmd_S_out", after, "F_cmd_S") for after in ("propulsion", "allocation")}
ARM = {("wrench_cmd_S_out", "arm_controller", "F_cmd_S")}
"""Safety monitor and safety filter pass on the force and leave the torque alone."""

DRIVEN_OTHERWISE = {
    "ppc_tracking_filtered": FORCE_ALONE,
    "ppc_tracking_guarded": FORCE_ALONE,
    "sync_approach_thrusters_filtered": FORCE_ALONE,
    "sync_approach_thrusters_guarded": FORCE_ALONE,
    "servicing_mission": VIRTUAL | FORCE_ALONE,
    "servicing_mission_filtered": VIRTUAL | FORCE_ALONE,
    "servicing_mission_navigated": VIRTUAL | FORCE_ALONE,
    "servicing_mission_by_arm": VIRTUAL | ARM,
}
"""Members of a joined pair that the system drives from a further terminal."""


@cache
def terminals_of(fmu):
    """Return name and kind of the terminals by member variable, and members by terminal."""
    twin = fmu.parent.parent / "fmus3" / fmu.name
    with zipfile.ZipFile(twin) as archive:
        root = etree.fromstring(archive.read(FILE))
    place, members = {}, {}
    for terminal in root.iter("Terminal"):
        key = terminal.get("name"), terminal.get("terminalKind")
        members[key] = {
            m.get("memberName"): m.get("variableName")
            for m in terminal.iter("TerminalMemberVariable")
        }
        place.update({variable: (key, member) for member, variable in members[key].items()})
    return place, members


@pytest.mark.parametrize("name", some(sorted(paths.systems()), 6, 3))
def test_terminals_alone_give_the_connections_of_the_system(name):
    with load(name) as system:
        fmus = {c.name: paths.fmus()[c.fmu.stem] for c in system.components}
        wired = {
            ((c.source[0], base(c.source[1])), (c.target[0], base(c.target[1])))
            for c in system.connections
        }
    plugs = defaultdict(set)
    for (a, output), (b, given) in wired:
        (one, _), (other, _) = terminals_of(fmus[a])[0][output], terminals_of(fmus[b])[0][given]
        plugs[a, one, b, other].add((output, given))
    joined, further = set(), set()
    for a, one, b, other in plugs:
        offered, read = terminals_of(fmus[a])[1][one], terminals_of(fmus[b])[1][other]
        assert one[1] == other[1]
        for member in offered.keys() & read.keys():
            pair = ((a, offered[member]), (b, read[member]))
            joined.add(pair)
            if pair not in wired:
                further.add((one[0], b, read[member]))
    assert wired <= joined
    assert further <= DRIVEN_OTHERWISE.get(name, set())
    assert bool(further) == (name in DRIVEN_OTHERWISE)
    targets = {target for _, target in wired}
    assert all(target in targets for _, target in joined - wired)
