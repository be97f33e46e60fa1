# SPDX-License-Identifier: BSD-2-Clause
"""Terminals alone connect every system as its description does, also in the draft of SSP 2.1."""

from __future__ import annotations

import zipfile
from collections import Counter, defaultdict
from dataclasses import replace
from functools import cache

import pytest
from lxml import etree

from harness import export, load
from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.ssp.writer import write_ssp
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


# ---- SSP 2.1 as proposed


def written(name, path):
    """Write a system with FMUs of FMI 3.0 as SSP 2.1; return its description."""
    with load(name) as system:
        fmus = [paths.fmus()[c.fmu.stem] for c in system.components]
        components = tuple(
            replace(c, fmu=fmu.parent.parent / "fmus3" / fmu.name)
            for c, fmu in zip(system.components, fmus, strict=True)
        )
        write_ssp(replace(system, components=components), path, 2.1)
        ends = {(f"{a[0]}.{base(a[1])}", f"{b[0]}.{base(b[1])}") for a, b, *_ in system.connections}
    with zipfile.ZipFile(path) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))
    return root, fmus, ends


SINGLE = {"space_robot", "transposition"}
"""Systems whose terminals have one connected member each."""


@pytest.mark.parametrize("name", some(sorted({*paths.systems()} - SINGLE), 10, 2))
def test_terminals_of_a_draft_represent_the_connections_of_their_members(name, tmp_path):
    """Members join by their names, and the FMU states their variables."""
    root, fmus, wired = written(name, tmp_path / "draft.ssp")
    defined = {
        each.get("name"): (
            each.get("terminalKind"),
            {c.get("name") for c in each.iter("{*}Connector")},
        )
        for each in root.iterfind("{*}Terminals/{*}Terminal")
    }
    plugs = {}
    for component, fmu in zip(root.iterfind(".//{*}Elements/{*}Component"), fmus, strict=True):
        stated = {key[0]: (key[1], members) for key, members in terminals_of(fmu)[1].items()}
        for row in component.iterfind("{*}Connectors/{*}Connector[@kind='terminal']"):
            kind, members = stated[row.get("name")]
            assert defined.pop(row.find("{*}Terminal").get("name")) == (kind, members.keys())
            plugs[component.get("name"), row.get("name")] = members
    assert not defined
    joined = Counter()
    for c in root.iter("{*}Connection"):
        a, x, b, y = (c.get(f"{e}{p}") for e in ("start", "end") for p in ("Element", "Connector"))
        one, two = (plugs.get(end, {"": base(end[1])}) for end in ((a, x), (b, y)))
        joined.update((f"{a}.{one[m]}", f"{b}.{two[m]}") for m in one.keys() & two.keys())
    assert set(joined) == wired
    terminals = sum((c.get("startElement"), c.get("startConnector")) in plugs
                    for c in root.iter("{*}Connection"))  # fmt: skip
    assert terminals >= 3


def test_the_harness_runs_no_draft(tmp_path):
    written("sync_approach", tmp_path / "draft.ssp")
    with pytest.raises(StructureError, match=r"SSP 2\.1 is a draft") as error:
        load(tmp_path / "draft.ssp").__enter__()
    assert len(str(error.value).splitlines()) == 1


def test_systems_without_terminals_cannot_be_a_draft(tmp_path):
    for name in SINGLE:
        with pytest.raises(UsageError, match="no terminal of an FMU has two connected members"):
            written(name, tmp_path / "draft.ssp")
    with pytest.raises(UsageError, match="no terminal of an FMU has two connected members"):
        export("sync_approach", tmp_path / "draft.ssp", ssp=2.1)
    with pytest.raises(UsageError, match=r"expected 1, 2 or 2\.1, got 1\.5"):
        export("sync_approach", tmp_path / "draft.ssp", ssp=1.5)
