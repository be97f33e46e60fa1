# SPDX-License-Identifier: BSD-2-Clause
"""TOML to .ssp: wiring by name, parameter sets, the dialect that other tools accept, and all
mistakes at once.
"""

from __future__ import annotations

import itertools
import re
import tomllib
import zipfile
from dataclasses import replace

import pytest
from fmpy.ssp.ssd import read_ssd
from lxml import etree

from harness.errors import StructureError
from harness.files.archive import pack
from harness.ssp import reader as ssp
from harness.ssp.build import build, main, system_of
from harness.ssp.extends import extended
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.system.model import Connection, Port
from tests.each import each

TOML = """
name = "demo"
description = "A source, a vector, and a slow gain"
[experiment]
stop = 12.0
step = 1.0
algorithm = "gauss-seidel"
[components]
first = "source"
second = "vector"
third = "gain"
[schedule.third]
every = 3
latency = 2
[open]
"third.u" = 0.5
[parameters.shared]
k = 4
[parameters.second]
J = [[1, 2], [3, 4]]
M.bias = 0.125
[sets.other]
description = "another bias"
[sets.other.second]
M.bias = 8
[sets.other.experiment]
stop = 6.0
"""


def composed(fmus, text=TOML):
    return system_of(tomllib.loads(text), fmus)


def problems(fmus, text):
    with pytest.raises(StructureError) as caught:
        composed(fmus, text)
    return list(caught.value.problems)


@pytest.fixture
def archive(fmus, tmp_path):
    path = tmp_path / "demo.ssp"
    write_ssp(composed(fmus), path)
    return path


# ---- what is read


def test_inputs_are_driven_by_the_output_of_their_name(fmus):
    assert composed(fmus).connections == tuple(
        Connection(Port("first", f"v[{i}]"), Port("second", f"v[{i}]")) for i in (1, 2, 3)
    )


def test_parameters_open_inputs_sets_and_schedule_arrive_where_they_belong(fmus):
    system = composed(fmus)
    first, second, third = system.components
    assert {n: p.value for n, p in second.parameters.items()} == {
        "J[1,1]": 1.0,
        "J[1,2]": 2.0,
        "J[2,1]": 3.0,
        "J[2,2]": 4.0,
        "M.bias": 0.125,
    }
    assert {n: p.value for n, p in third.parameters.items()} == {"u": 0.5, "k": 4.0}
    assert (first.every, third.every, third.latency) == (1, 3, 2)
    other = system.sets[0]
    assert (other.name, other.description, other.stop, other.step) == (
        "other",
        "another bias",
        6.0,
        None,
    )
    assert other.parameters["second"]["M.bias"].value == 8.0
    assert other.parameters["second"]["J[2,1]"].value == 3.0  # a parameter set is complete
    assert system.strict


def test_an_explicit_connection_wins_over_the_name_and_may_name_single_elements(fmus):
    text = TOML.replace(
        '[open]\n"third.u" = 0.5', '[connections]\n"third.u" = "second.w[3]"'
    ).replace("w[3]", "w[3]")
    with pytest.raises(StructureError, match=r"third\.u: expected unit 1, second\.w\[3\] has m"):
        composed(fmus, text)
    swapped = TOML + '[connections]\n"second.v[1]" = "first.v[2]"\n"second.v[2]" = "first.v[1]"\n'
    wires = {str(c.target): str(c.source) for c in composed(fmus, swapped).connections}
    assert wires == {
        "second.v[1]": "first.v[2]",
        "second.v[2]": "first.v[1]",
        "second.v[3]": "first.v[3]",
    }


# ---- mistakes


@each(
    ("change", "expected"),
    [
        (('first = "source"', 'first = "sauce"'), ["first: there is no FMU sauce (close: source)"]),
        (
            ("[schedule.third]", "[schedule.thirt]"),
            ["schedule.thirt: the system defines no such name (close: third, first)"],
        ),
        (
            ("every = 3\nlatency = 2", 'every = "often"'),
            ["schedule.third.every: must be a whole number of at least 1, not 'often'"],
        ),
        (
            ("step = 1.0", "step = 1.0\nevery = 2.5"),
            ["experiment.every: must be a whole number of at least 1, not 2.5"],
        ),
        (("step = 1.0", "stepp = 1.0"), None),
        (("stop = 12.0", "stop = 12.5"), None),
        (
            ("latency = 2", "latency = 4"),
            ["third: latency must lie in 0..3 macro steps under gauss-seidel, not 4"],
        ),
        (("[parameters.second]", "[parameters.sekond]"), None),
        (
            ("k = 4", "kk = 4"),
            ["parameters.shared.kk: no component has such a parameter (close: k)"],
        ),
        (
            ("M.bias = 0.125", "M.bios = 0.125"),
            ["parameters.second.M.bios: there is no such variable (close: M.bias)"],
        ),
        (
            ("J = [[1, 2], [3, 4]]", "J = [1, 2]"),
            [
                "parameters.second.J: expected 2 x 2 elements, got 2 elements; the FMU "
                "fixes the number of elements",
            ],
        ),
        (("M.bias = 8", "M.bias = nan"), ["sets.other.second.M.bias: it must not be NaN"]),
        (('"third.u" = 0.5', '"third.v" = 0.5'), None),
        (('"third.u" = 0.5', '"fourth.u" = 0.5'), None),
        (
            ('"third.u" = 0.5', ""),
            ["third.u: no output of this name: connect it in [connections] or list it in [open]"],
        ),
        (('third = "gain"', 'third = "source"'), None),
        (('name = "demo"', "title = 1"), None),
    ],
)
def test_mistakes_are_described(fmus, change, expected):
    found = problems(fmus, TOML.replace(*change))
    assert found
    assert expected is None or found == expected


def test_an_ambiguous_input_names_the_candidates(fmus):
    text = TOML.replace('first = "source"', 'first = "source"\nagain = "source"')
    assert problems(fmus, text) == [
        "second.v: ambiguous, first and again have an output of this name: choose in [connections]"
    ]


def test_an_input_that_is_driven_and_left_open_or_driven_twice_is_rejected(fmus):
    text = TOML.replace("[open]", '[open]\n"second.v" = [0, 0, 0]')
    both = text + '[connections]\n"second.v" = "first.v"\n"second.v[1]" = "first.v[1]"\n'
    assert "second.v: is left open, but a connection drives it" in problems(fmus, both)
    assert "second.v[1]: is driven by two connections, remove one" in problems(fmus, both)


def test_connections_between_unequal_shapes_or_unknown_ports_are_rejected(fmus):
    text = (
        TOML
        + '[connections]\n"second.v" = "first.v[1]"\n"third.uu" = "first.v"\n'
        + '"fifth.u" = "first.v"\n"u" = "first.v"\n'
    )
    found = problems(fmus, text)
    assert "second.v: has 3 elements, first.v[1] has 1" in found
    assert "third.uu: there is no such input (close: u)" in found
    assert "fifth.u: there is no component 'fifth' (close: first)" in found
    assert "u: expected component.variable, as in first.u" in found


def test_all_mistakes_come_at_once(fmus):
    text = (
        TOML.replace('"third.u" = 0.5', "")
        .replace("k = 4", "kk = 4")
        .replace("latency = 2", "latency = 9")
    )
    assert len(problems(fmus, text)) == 3


# ---- what is written


def test_reading_back_gives_the_same_system(fmus, archive):
    system = composed(fmus)
    with ssp.opened(archive) as back:
        at_home = tuple(replace(c, fmu=fmus[c.fmu.stem]) for c in back.components)
        assert replace(back, components=at_home) == system


def test_the_same_system_gives_the_same_bytes(fmus, tmp_path, archive):
    again = tmp_path / "again.ssp"
    write_ssp(composed(fmus), again)
    assert again.read_bytes() == archive.read_bytes()


def test_the_description_is_valid_and_read_by_fmpy(archive):
    ssd = read_ssd(str(archive))
    assert ssd.name == "demo"
    assert [c.name for c in ssd.system.elements] == ["first", "second", "third"]


def test_the_dialect_is_the_one_that_other_tools_match_as_text(archive):
    with zipfile.ZipFile(archive) as files:
        text = files.read("SystemStructure.ssd").decode()
        sets = [
            files.read(n).decode()
            for n in files.namelist()
            if re.fullmatch(r"resources/\w+\.ssv", n)
        ]
    root = etree.fromstring(text.encode())
    assert [etree.QName(e).localname for e in root] == [
        "System",
        "Units",
        "DefaultExperiment",
    ]
    opening = text[text.index("<ssd:SystemStructureDescription") : text.index("<ssd:System ")]
    for prefix in ("ssd", "ssc", "ssv", "osp"):
        assert f"xmlns:{prefix}=" in opening
    assert 'version="1.0"' in opening
    assert '<ssd:DefaultExperiment startTime="0.0" stopTime="12.0">' in text
    assert '<osp:FixedStepAlgorithm baseStepSize="1.0" numWorkerThreads="0"/>' in text
    assert '<oms:FixedStepMaster description="oms-ma" stepSize="1.0"' in text
    allowed = {"System", "DefaultExperiment"}  # OMSimulator rejects annotations of others
    owners = [annotations.getparent() for annotations in root.iter("{*}Annotations")]
    assert {etree.QName(owner).localname for owner in owners} - {"Annotation"} == allowed
    assert (
        'type="application/x-fmu-sharedlibrary" source="resources/source.fmu"'
        ' implementation="CoSimulation"' in text
    )
    assert sets
    assert all('name="default"' in each for each in sets)


def test_hints_are_the_periods_of_slow_components(archive, tmp_path):
    with load(archive) as system:
        write_ssp(system, tmp_path / "hinted.ssp", hints=True)
        slow = {c.name: c.every * system.experiment.step for c in system.components if c.every > 1}
    with zipfile.ZipFile(tmp_path / "hinted.ssp") as files:
        root = etree.fromstring(files.read("SystemStructure.ssd"))
    hints = {
        component.get("name"): float(hint.get("value"))
        for component in root.iter("{*}Component")
        for hint in component.iter("{*}StepSizeHint")
    }
    assert hints == slow
    assert slow


def test_only_connected_ports_have_connectors_each_with_type_unit_and_place(archive):
    with zipfile.ZipFile(archive) as files:
        root = etree.fromstring(files.read("SystemStructure.ssd"))
    ns = {"ssd": root.nsmap["ssd"], "ssc": root.nsmap["ssc"]}
    connectors = root.findall(".//ssd:Connector", ns)
    assert [(c.get("name"), c.get("kind")) for c in connectors] == [
        *((f"v[{i}]", "output") for i in (1, 2, 3)),
        *((f"v[{i}]", "input") for i in (1, 2, 3)),
    ]
    for connector in connectors:
        assert connector.find("ssc:Real", ns).get("unit") == "m"
        place = connector.find("ssd:ConnectorGeometry", ns)
        assert place.get("x") == {"input": "0", "output": "1"}[connector.get("kind")]
        assert 0 < float(place.get("y")) < 1
    blocks = [e.attrib for e in root.findall(".//ssd:ElementGeometry", ns)]
    assert all(float(a["x2"]) < float(b["x1"]) for a, b in itertools.pairwise(blocks))
    assert root.find(".//ssd:SystemGeometry", ns) is None  # OMSimulator rejects it
    assert root.find(".//ssd:Units/ssc:Unit[@name='m']/ssc:BaseUnit", ns).get("m") == "1"


def test_a_parameter_set_states_what_its_units_are(tmp_path):
    with load("relay_approach") as system:
        write_ssp(system, tmp_path / "x.ssp")
    with zipfile.ZipFile(tmp_path / "x.ssp") as files:
        sets = [etree.fromstring(files.read(n)) for n in files.namelist() if n.endswith(".ssv")]
    used = 0
    for root in sets:
        ns = {prefix: uri for prefix, uri in root.nsmap.items() if prefix}
        reported = {unit.get("name") for unit in root.iterfind("ssv:Units/ssc:Unit", ns)}
        units = {real.get("unit") for real in root.iterfind(".//ssv:Real[@unit]", ns)}
        assert units <= reported
        used += len(units)
    assert used > 10


@pytest.fixture
def entries(archive):
    with zipfile.ZipFile(archive) as files:
        return {name: files.read(name) for name in files.namelist()}


def test_a_system_of_ours_stays_strict_about_open_inputs(entries, archive, tmp_path):
    with ssp.opened(archive) as back:
        assert back.strict
    text = entries["SystemStructure.ssd"].decode()
    assert 'strict="true"' in text
    entries["SystemStructure.ssd"] = text.replace(' strict="true"', "").encode()
    pack(tmp_path / "x.ssp", entries)
    with ssp.opened(tmp_path / "x.ssp") as back:
        assert not back.strict


def test_a_set_that_is_listed_has_its_files(entries, tmp_path):
    lost = {name: data for name, data in entries.items() if not name.startswith("resources/sets/")}
    assert 0 < len(lost) < len(entries)
    pack(tmp_path / "x.ssp", lost)
    problem = "parameter set other: is listed, but the archive has no valid file with its values"
    with pytest.raises(StructureError, match=problem), ssp.opened(tmp_path / "x.ssp"):
        pass


def test_a_component_without_a_period_or_latency_steps_at_every_step(entries, tmp_path):
    text = entries["SystemStructure.ssd"].decode()
    bare = re.sub(r'(<run:Component name="\w+") every="\d+" latency="\d+"', r"\1", text)
    assert bare != text
    entries["SystemStructure.ssd"] = bare.encode()
    pack(tmp_path / "x.ssp", entries)
    with ssp.opened(tmp_path / "x.ssp") as back:
        assert {(c.every, c.latency) for c in back.components} == {(1, 0)}


def test_two_fmus_of_one_file_name_are_retained_apart(fmus, tmp_path):
    (tmp_path / "else").mkdir()
    namesake = tmp_path / "else" / "gain.fmu"
    namesake.write_bytes(fmus["counter"].read_bytes())
    system = system_of(
        tomllib.loads(
            'name = "x"\n[experiment]\nstop = 1\nstep = 1\n'
            '[components]\na = "gain"\nb = "namesake"\n[open]\n"a.u" = 0'
        ),
        {**fmus, "namesake": namesake},
    )
    write_ssp(system, tmp_path / "x.ssp")
    with ssp.opened(tmp_path / "x.ssp") as back:
        assert [c.fmu.read_bytes() for c in back.components] == [
            fmus[n].read_bytes() for n in ("gain", "counter")
        ]


def test_one_unit_name_with_two_meanings_is_rejected(fmus, tmp_path):
    from tests.harness.third_party_fmu import Model, y
    from tests.harness.third_party_fmu import build as build_fmu

    odd = Model("odd", [y("distance", "m")])
    path = build_fmu(odd, tmp_path)
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, data in parts.items():
            new.writestr(
                name, data.replace(b'<BaseUnit m="1"/>', b'<BaseUnit m="1" factor="1000"/>')
            )
    text = 'name = "x"\n[experiment]\nstop = 1\nstep = 1\n[components]\na = "source"\nb = "odd"\n'
    system = system_of(tomllib.loads(text), {**fmus, "odd": path})
    with pytest.raises(
        StructureError, match="b: defines the unit m differently from another component"
    ):
        write_ssp(system, tmp_path / "x.ssp")


# ---- the command


def test_the_build_command_writes_the_file(fmu_folder, tmp_path, capsys):
    (tmp_path / "demo.toml").write_text(TOML)
    assert (
        main(
            [
                str(tmp_path / "demo.toml"),
                "--fmus",
                str(fmu_folder),
                "-o",
                str(tmp_path / "demo.ssp"),
            ]
        )
        == 0
    )
    assert (tmp_path / "demo.ssp").is_file()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("text", "status", "line"),
    [
        ("name = ", 1, r"demo\.toml: not a readable TOML file \(.*\)"),
        (None, 2, r".*demo\.toml: cannot be read \(No such file or directory\)"),
        (TOML.replace("k = 4", "kk = 4"), 1, r"demo\.toml: parameters\.shared\.kk: .*"),
        ('extends = "dem"', 1, r"demo\.toml: extends: there is no system dem \(close: demo\)"),
        ('extends = "demo"', 1, r"demo\.toml: extends: demo extends this system itself"),
    ],
)
def test_the_build_command_states_in_one_line_what_is_wrong(
    fmu_folder, tmp_path, capsys, text, status, line
):
    source = tmp_path / "demo.toml"
    if text is not None:
        source.write_text(text)
    assert (
        main([str(source), "--fmus", str(fmu_folder), "-o", str(tmp_path / "demo.ssp")]) == status
    )
    assert re.fullmatch(line + "\n", capsys.readouterr().err)
    assert not (tmp_path / "demo.ssp").exists()


def test_a_file_that_extends_drives_what_its_base_leaves_open(tmp_path):
    """The constant of the base gives way to the connection; other inputs retain theirs."""
    (tmp_path / "demo.toml").write_text(TOML)
    upper = tmp_path / "upper.toml"
    upper.write_text('extends = "demo"\n[connections]\n"third.u" = "second.n"\n')
    assert extended(upper)["open"] == {}
    upper.write_text('extends = "demo"\n[connections]\n"second.u" = "first.y"\n')
    assert extended(upper)["open"] == {"third.u": 0.5}


def test_a_system_extends_one_that_extends_another(fmus, fmu_folder, tmp_path):
    (tmp_path / "demo.toml").write_text(TOML)
    middle = 'extends = "demo"\n[parameters.second]\nM.bias = 2\n[parameters.third]\nk = 5\n'
    (tmp_path / "middle.toml").write_text(middle)
    last = f'extends = "{tmp_path.name}_middle"\n[parameters.second]\nM.bias = 3\n'
    (tmp_path / "last.toml").write_text(last)
    build(tmp_path / "last.toml", fmu_folder, tmp_path / "last.ssp")
    with ssp.opened(tmp_path / "last.ssp") as system:
        assert system.component("second").parameters["M.bias"].value == 3
        assert system.component("third").parameters["k"].value == 5
        assert system.name == f"{tmp_path.name}_last"
    (tmp_path / "demo.toml").write_text(f'extends = "{tmp_path.name}_last"\n')
    with pytest.raises(StructureError, match="extends this system itself"):
        build(tmp_path / "last.toml", fmu_folder, tmp_path / "last.ssp")


def test_the_nearest_of_systems_with_equal_names_is_extended(tmp_path):
    """`b` is a file beside the extending file, or a mission beside its folder, in this order."""
    for folder, name, value in (("a", "b", 1.0), ("b", "system", 2.0)):
        (tmp_path / folder).mkdir()
        text = TOML.replace("[parameters.second]", f"[parameters.second]\nk = {value}")
        (tmp_path / folder / f"{name}.toml").write_text(text)
    upper = tmp_path / "a" / "upper.toml"
    upper.write_text('extends = "b"\n')
    assert extended(upper)["parameters"]["second"]["k"] == 1
    (tmp_path / "a" / "b.toml").unlink()
    assert extended(upper)["parameters"]["second"]["k"] == 2


def test_a_system_that_extends_another_states_what_is_otherwise(fmus, fmu_folder, tmp_path):
    (tmp_path / "demo.toml").write_text(TOML)
    own = 'extends = "demo"\nname = "mine"\n[connections]\n"second.v[2]" = "first.v[1]"\n'
    (tmp_path / "mine.toml").write_text(own + "[parameters.second]\nM.bias = 2\n")
    build(tmp_path / "mine.toml", fmu_folder, tmp_path / "mine.ssp")
    plain = composed(fmus)
    with ssp.opened(tmp_path / "mine.ssp") as system:
        assert (system.name, system.description) == ("mine", plain.description)
        second = dict(system.component("second").parameters)
        changed = second.pop("M.bias")
        before = dict(plain.component("second").parameters)
        assert (changed.value, before.pop("M.bias").value) == (2, 0.125)
        assert second == before
        assert Connection(Port("first", "v[1]"), Port("second", "v[2]")) in system.connections


def test_build_reports_the_place_it_cannot_write_to(fmu_folder, tmp_path, capsys):
    (tmp_path / "demo.toml").write_text(TOML)
    target = tmp_path / "demo.toml" / "demo.ssp"
    assert main([str(tmp_path / "demo.toml"), "--fmus", str(fmu_folder), "-o", str(target)]) == 1
    assert "cannot be written (File exists)" in capsys.readouterr().err


def test_build_is_a_function_too(fmu_folder, tmp_path):
    (tmp_path / "demo.toml").write_text(TOML)
    build(tmp_path / "demo.toml", fmu_folder, tmp_path / "demo.ssp")
    assert zipfile.is_zipfile(tmp_path / "demo.ssp")
