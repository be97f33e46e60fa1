# SPDX-License-Identifier: BSD-2-Clause
"""One fault at a time in a conforming description: `harness check` names each of them,
distinguishes errors from warnings, and reports the same as `run`.
"""

from __future__ import annotations

import ast
import inspect
import struct
import warnings
import zipfile
from typing import NamedTuple

import fmpy
import pytest
from fmpy.validation import validate_fmu

from harness import run
from harness.cli.app import main
from harness.conformance import check as conformance_check
from harness.conformance import deviations
from harness.conformance.check import examine
from harness.errors import FmuError
from harness.files import machine
from harness.system.interface import read_interface
from tests.each import each
from tests.fmi3 import test_rules as of_fmi3
from tests.harness.third_party_ssp import component, system, write

TOP = system("top", [component("gain", "gain")], [])
BINARY = f"binaries/{fmpy.platform}/gain{fmpy.sharedLibraryExtension}"

GOOD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="gain"
    guid="{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}" variableNamingConvention="structured">
  <CoSimulation modelIdentifier="gain"><SourceFiles><File name="gain.c"/></SourceFiles>
  </CoSimulation>
  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/><DisplayUnit name="km" factor="0.001"/></Unit>
    <Unit name="s"><BaseUnit s="1"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="Length"><Real unit="m" min="0" max="10"/></SimpleType>
    <SimpleType name="Mode"><Enumeration><Item name="off" value="1"/><Item name="on" value="2"/>
    </Enumeration></SimpleType>
  </TypeDefinitions>
  <LogCategories><Category name="logAll"/><Category name="logEvents"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="10" tolerance="1e-6" stepSize="0.1"/>
  <VendorAnnotations><Tool name="a"/><Tool name="b"/></VendorAnnotations>
  <ModelVariables>
    <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="y" valueReference="1" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="k" valueReference="2" causality="parameter" variability="fixed">
      <Real start="2" unit="m" displayUnit="km" min="1" max="5" nominal="2"/></ScalarVariable>
    <ScalarVariable name="n" valueReference="3" causality="local" variability="discrete">
      <Integer/></ScalarVariable>
    <ScalarVariable name="mode" valueReference="4" causality="parameter" variability="tunable">
      <Enumeration declaredType="Mode" start="2"/></ScalarVariable>
    <ScalarVariable name="time" valueReference="5" causality="independent">
      <Real/></ScalarVariable>
    <ScalarVariable name="x" valueReference="6"><Real unit="m"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="7"><Real derivative="7"/></ScalarVariable>
    <ScalarVariable name="c" valueReference="8" causality="calculatedParameter"
      variability="fixed"><Real declaredType="Length"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="2" dependencies="1" dependenciesKind="dependent"/></Outputs>
    <Derivatives><Unknown index="8" dependencies="1"/></Derivatives>
    <InitialUnknowns><Unknown index="2" dependencies="1"/><Unknown index="7"/>
      <Unknown index="8"/><Unknown index="9"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""

U = '<Real start="0"/>'
Y = 'causality="output"><Real/>'
K = 'start="2" unit="m" displayUnit="km" min="1" max="5" nominal="2"'
N = 'causality="local" variability="discrete">\n      <Integer/>'
TOOLS = '<Tool name="a"/><Tool name="b"/>'
ITEMS = '<Item name="off" value="1"/><Item name="on" value="2"/>'
UNITS = "</UnitDefinitions>"
OUTPUT = '<Outputs><Unknown index="2" dependencies="1" dependenciesKind="dependent"/>'
WHOLE = (
    '<CoSimulation modelIdentifier="gain"><SourceFiles><File name="gain.c"/></SourceFiles>\n'
    "  </CoSimulation>"
)
CAPABLE = '<CoSimulation modelIdentifier="gain"'


class Fault(NamedTuple):
    """Replacement in a description, and part of the message about it."""

    old: str
    new: str
    line: str


FATAL = {
    "a violated schema": Fault('modelName="gain"', "", "'modelName' is required"),
    "an unknown element": Fault("<ModelStructure>", "<What/><ModelStructure>", "What"),
    "no number": Fault('start="2" unit', 'start="two" unit', "two"),
    "an unknown causality": Fault('"local"', '"nowhere"', "nowhere"),
    "no type": Fault("<Real/></ScalarVariable>\n    <ScalarVariable name=\"k\"",
                     "</ScalarVariable>\n    <ScalarVariable name=\"k\"", "ScalarVariable"),
    "broken XML": Fault("</ModelStructure>", "", "not a readable XML file"),
    "a document type": Fault("<fmiModel", "<!DOCTYPE x><fmiModel", "document type"),
    "an odd encoding": Fault("UTF-8", "UTF-7", "its encoding UTF-7 is not supported"),
    "no version": Fault('fmiVersion="2.0" ', "", "fmiVersion is missing"),
    "FMI 1.0": Fault('fmiVersion="2.0"', 'fmiVersion="1.0"', "FMI 1.0 is not supported"),
    "FMI 4.0": Fault('fmiVersion="2.0"', 'fmiVersion="4.0"', "FMI 4.0 is not supported"),
    "model exchange": Fault(WHOLE,
                            '<ModelExchange modelIdentifier="gain"/>', "supports model exchange"),
    "two interfaces": Fault("<UnitDef", '<CoSimulation modelIdentifier="g"/><UnitDef', "twice"),
    "a path for a library": Fault(CAPABLE, '<CoSimulation modelIdentifier="../g"', "'../g'"),
    "equal names": Fault('name="n"', 'name="k"', "two variables have this name"),
    "an empty name": Fault('name="n"', 'name=""', "has no name"),
    "an undefined type": Fault('"Length"/></Sc', '"Width"/></Sc', "type Width is not defined"),
    "an unknown state": Fault('derivative="7"', 'derivative="70"', "variable 70 does not exist"),
    "an unknown output": Fault('<Outputs><Unknown index="2"', '<Outputs><Unknown index="20"',
                               "variable 20 does not"),
    "an unknown dependency": Fault('index="8" dependencies="1"', 'index="8" dependencies="90"',
                                   "variable 90 does not"),
    "equal names of items": Fault('name="on"', 'name="off"', "name off is given twice"),
}  # fmt: skip

ODD = {
    "an odd identifier": Fault(CAPABLE, '<CoSimulation modelIdentifier="g-n"', "C identifier"),
    "an empty model name": Fault('modelName="gain"', 'modelName=""', "modelName is empty"),
    "an empty guid": Fault('guid="{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}"', 'guid=""', "guid is"),
    "a guid without braces": Fault("{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}",
                                   "8c4e810f-3df3-4a00-8276-176fa3c9f9e0", "enclosed in braces"),
    "stop before start": Fault('stopTime="10"', 'stopTime="-1"', "stopTime -1 must lie"),
    "a negative step": Fault('stepSize="0.1"', 'stepSize="-0.1"', "stepSize -0.1 must be pos"),
    "a negative tolerance": Fault('"1e-6"', '"-1e-6"', "tolerance -1e-6 must be pos"),
    "an infinite time": Fault('startTime="0"', 'startTime="-INF"', "startTime -INF must be fin"),
    "equal log categories": Fault("logEvents", "logAll", "name logAll is given twice"),
    "equal tools": Fault(TOOLS, '<Tool name="a"/><Tool name="a"/>', "name a is given twice"),
    "equal tools of a variable": Fault(
        Y, Y + '<Annotations><Tool name="a"/><Tool name="a"/></Annotations>', "name a is given"
    ),
    "equal units": Fault(UNITS, '<Unit name="m"/></UnitDefinitions>', "name m is given twice"),
    "equal display units": Fault(
        '"0.001"/>', '"0.001"/><DisplayUnit name="km"/>', "name km is given twice"
    ),
    "a factor of zero": Fault('<BaseUnit s="1"/>', '<BaseUnit s="1" factor="0"/>', "must not be 0"),
    "equal types": Fault("</TypeDefinitions>", '<SimpleType name="Length"><Real unit="m"/>'
                         "</SimpleType></TypeDefinitions>", "name Length is given twice"),
    "a type like a variable": Fault("<TypeDefinitions>", '<TypeDefinitions><SimpleType name="x">'
                                    "<Real/></SimpleType>", "a type has the same name"),
    "equal items": Fault('name="on" value="2"', 'name="on" value="1"', "value 1 is given twice"),
    "crossed limits of a type": Fault('min="0" max="10"', 'min="11" max="10"', "min 11 exceeds"),
    "an undefined unit of a type": Fault('<Real unit="m" min="0"', '<Real unit="ly" min="0"',
                                         "the type Length: its unit ly is not defined"),
    "another type": Fault("<Integer/>", '<Integer declaredType="Length"/>', "type is Real"),
    "a discrete derivative": Fault('name="x" valueReference="6">', 'name="x" valueReference="6" '
                                   'variability="discrete">', "so both must be continuous"),
    "an odd name": Fault('name="n"', 'name="n 1"', "naming convention 'structured'"),
    "a continuous Integer": Fault(N, "><Integer/>", "is Integer, which cannot be continuous"),
    "a continuous parameter": Fault('causality="parameter" variability="fixed"',
                                    'causality="parameter"', "parameter cannot be continuous"),
    "initial of an input": Fault('causality="input"', 'causality="input" initial="exact"',
                                 "input cannot have initial"),
    "an impossible initial": Fault('variability="tunable"', 'variability="tunable" initial='
                                   '"approx"', "tunable parameter cannot have initial='approx'"),
    "no start": Fault(U, "<Real/>", "has no start value"),
    "a start of what is calculated": Fault(Y, 'causality="output"><Real start="1"/>',
                                           "is calculated, but has a start value"),
    "a start of time": Fault('"independent">\n      <Real/>', '"independent"><Real start="1"/>',
                             "is the independent variable, but has a start value"),
    "two times": Fault(N, 'causality="independent"><Real/>', "than one variable is independent"),
    "a time that is no Real": Fault('"independent">\n      <Real/>', '"independent" variability='
                                    '"discrete"><Integer/>', "independent variable, but Integer"),
    "crossed limits": Fault('min="1" max="5"', 'min="6" max="5"', "min 6 exceeds max 5"),
    "a start outside": Fault('start="2" unit="m"', 'start="7" unit="m"', "lies outside [1, 5]"),
    "a start that is no item": Fault('Mode" start="2"', 'Mode" start="3"', "is not an item"),
    "an infinite start": Fault(U, '<Real start="INF"/>', "start INF must be finite"),
    "a nominal value of 0": Fault('nominal="2"', 'nominal="0"', "nominal must not be 0"),
    "an undefined unit": Fault('<Real unit="m"/>', '<Real unit="ly"/>', "unit ly is not defined"),
    "an undefined display unit": Fault('displayUnit="km"', 'displayUnit="AU"', "unit AU is not"),
    "a display unit without a unit": Fault(U, '<Real start="0" displayUnit="km"/>', "unit km is"),
    "reinit": Fault('<Real unit="m"/>', '<Real unit="m" reinit="true"/>', "reinit is valid only"),
    "several sets": Fault('causality="input"', 'causality="input" '
                          'canHandleMultipleSetPerTimeInstant="true"', "only for inputs in model"),
    "a shared reference": Fault('valueReference="2"', 'valueReference="0"', "one of them may be"),
    "a shared reference, other unit": Fault('valueReference="6"', 'valueReference="7"', "be equal"),
    "a constant alias": Fault(
        'valueReference="3" causality="local" variability="discrete">\n      <Integer/>',
        'valueReference="1" variability="constant"><Real start="1"/>', "all or none must be",
    ),
    "an output listed twice": Fault("</Outputs>", '<Unknown index="2"/></Outputs>', "given twice"),
    "a missing output": Fault(
        "</ModelVariables>",
        f'<ScalarVariable name="z" valueReference="9" {Y}</ScalarVariable></ModelVariables>',
        "Outputs: must list z",
    ),
    "no output": Fault("</Outputs>", '<Unknown index="4"/></Outputs>', "must not list n"),
    "kinds without dependencies": Fault('<Unknown index="2" dependencies="1" dependenciesKind',
                                        '<Unknown index="2" dependenciesKind', "expected 0 dep"),
    "fewer kinds": Fault(OUTPUT, OUTPUT.replace('"1"', '"1 3"'), "2 dependency kinds, got 1"),
    "a kind for steps": Fault(
        '<InitialUnknowns><Unknown index="2" dependencies="1"',
        '<InitialUnknowns><Unknown index="2" dependencies="1" dependenciesKind="fixed"',
        "dependenciesKind is fixed, expected dependent or constant",
    ),
    "a derivative of nothing": Fault(' derivative="7"', "", "the attribute derivative of "),
    "a missing initial unknown": Fault('<Unknown index="9"/>', "", "must list c"),
    "an initial unknown too many": Fault('<Unknown index="9"/>', '<Unknown index="9"/>'
                                         '<Unknown index="1"/>', "must not list u"),
}  # fmt: skip


@pytest.fixture
def packed(fmus, tmp_path):
    """An FMU with a description of our own, the library of the model `gain`, and further files."""

    def pack(text, files=None, binary=BINARY):
        path = tmp_path / "gain.fmu"
        with zipfile.ZipFile(fmus["gain"]) as good:
            library = good.read(BINARY)
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", text)
            content = {binary: library, "sources/gain.c": b""} | (files or {})
            content[BINARY.replace("gain", "g-n")] = library if binary == BINARY else None
            for name, data in content.items():
                if data is not None:
                    archive.writestr(name, data)
        return path

    return pack


def with_fault(fault):
    assert fault.old in GOOD
    return GOOD.replace(fault.old, fault.new, 1)


def test_a_conforming_fmu_has_no_fault_in_our_checks_nor_in_fmpy(packed, capsys):
    path = packed(GOOD)
    found = examine(path)
    assert (found.errors, found.warnings) == ((), ())
    assert validate_fmu(str(path)) == []
    assert main(["check", str(path), "--strict"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("kind", FATAL)
def test_an_error_is_status_1_and_run_states_the_same(packed, capsys, kind):
    path = packed(with_fault(FATAL[kind]))
    assert main(["check", str(path)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert any(FATAL[kind].line in line for line in lines), lines
    with pytest.raises(FmuError) as caught:
        read_interface(path)
    errors = [line for line in lines if ": warning: " not in line]
    assert errors == [f"harness: {line}" for line in str(caught.value).splitlines()]


@pytest.mark.parametrize("kind", ODD)
def test_a_warning_is_status_0_and_status_1_on_demand(packed, capsys, kind):
    path = packed(with_fault(ODD[kind]))
    assert main(["check", str(path)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert any(ODD[kind].line in line for line in lines), lines
    assert all(line.startswith("harness: warning: gain.fmu: ") for line in lines)
    assert main(["check", str(path), "--strict"]) == 1
    read_interface(path)


@each("kind", [*FATAL, *ODD])
def test_no_fault_that_fmpy_finds_is_missed(packed, kind):
    if kind in ("a document type", "an odd encoding"):
        pytest.skip("is not to be parsed")
    path = packed(with_fault((FATAL | ODD)[kind]))
    with warnings.catch_warnings(action="ignore"):
        theirs = validate_fmu(str(path))
    found = examine(path)
    assert len(found.errors + found.warnings) >= bool(theirs)


def messages(module):
    """Of each line that a module of rules can say the longest piece that is always the same."""
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Yield):
            pieces = [n.value for n in ast.walk(node) if isinstance(n, ast.Constant)]
            yield max((p for p in pieces if isinstance(p, str)), key=len)


def test_every_line_of_the_rules_is_reported_for_one_of_the_faults(packed, tmp_path):
    flat = GOOD.replace('"structured"', '"flat"').replace('"n"', '"n&#9;1"')
    verdicts = [examine(packed(with_fault(fault))) for fault in (FATAL | ODD).values()]
    verdicts += [examine(packed(flat, {"notes.txt": b""}))]
    tables = {**of_fmi3.ERRORS, **of_fmi3.WARNINGS}.values()
    verdicts += [examine(of_fmi3.with_fault(tmp_path, *edit)) for *edit, _ in tables]
    bare = {k: v for k, v in of_fmi3.FILES.items() if k != of_fmi3.B}
    verdicts += [examine(of_fmi3.written(tmp_path, bare))]
    reported = "\n".join(line for v in verdicts for line in (*v.errors, *v.warnings))
    texts = [m for module in (deviations, conformance_check) for m in messages(module)]
    assert [m for m in texts if m not in reported] == []


def test_there_are_at_least_44_kinds():
    assert len(FATAL) + len(ODD) >= 44


# ---- the archive


@pytest.mark.parametrize(
    ("files", "line"),
    [
        (
            {"notes.txt": b""},
            "notes.txt: not permitted at the top of the archive; move it to extra/",
        ),
        (
            {"stuff/notes.txt": b""},
            "stuff: not permitted at the top of the archive; move it to extra/",
        ),
        ({"sources/gain.c": None}, "the source file sources/gain.c is listed, but not in the"),
    ],
)
def test_odd_archives_are_warnings(packed, capsys, files, line):
    assert main(["check", str(packed(GOOD, files))]) == 0
    assert line in capsys.readouterr().err


def appended(path, name):
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr(name, "")


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda p: p.write_bytes(b"MZ" * 50 + p.read_bytes()), "damaged or not a zip archive"),
        (lambda p: p.write_bytes(p.read_bytes()[:-30]), "damaged or not a zip archive"),
        (lambda p: appended(p, "modelDescription.xml"), "two files of one name"),
        (lambda p: appended(p, "resources//a") or appended(p, "resources/a"), "two files of one"),
        (lambda p: appended(p, "../x"), "a path that leaves the archive"),
        (lambda p: p.write_bytes(b""), "damaged or not a zip archive"),
    ],
)
def test_check_and_run_reject_the_same_archives(packed, fmus, tmp_path, capsys, spoil, line):
    path = packed(GOOD)
    spoil(path)
    assert main(["check", str(path)]) == 1
    assert line in capsys.readouterr().err
    top = system("top", [component("gain", "gain")], [])
    whole = str(write(tmp_path / "x.ssp", top, {"gain": path}))
    for arguments in (["check", whole], ["run", whole, "-o", str(tmp_path / "x.csv")]):
        assert main(arguments) == 1
        assert line in capsys.readouterr().err


def test_check_and_run_reject_a_binary_of_another_platform(packed, tmp_path, capsys):
    path = packed(GOOD, binary="binaries/solaris/gain.so")
    assert main(["check", str(path)]) == 1
    assert "it holds no binary for this platform, only for solaris" in capsys.readouterr().err
    top = system("top", [component("gain", "gain")], [])
    whole = str(write(tmp_path / "x.ssp", top, {"gain": path}))
    for arguments in (["check", whole], ["run", whole, "-o", str(tmp_path / "x.csv")]):
        assert main(arguments) == 1
        assert "no binary for this platform" in capsys.readouterr().err


def elf(machine, bits=64, order="<"):
    """The header of a shared library of ELF, as readelf prints it."""
    ident = b"\x7fELF" + bytes([bits // 32, 1 if order == "<" else 2, 1]) + bytes(9)
    return ident + struct.pack(f"{order}HHI", 3, machine, 1) + bytes(40)


def pe(machine):
    """DOS stub and COFF header."""
    stub = b"MZ" + bytes(58) + struct.pack("<I", 128)
    return stub.ljust(128, b"\0") + b"PE\0\0" + struct.pack("<H", machine) + bytes(18)


def mach_o(*machines):
    """One machine, or a file for several."""
    if len(machines) == 1:
        return struct.pack("<IiiI", 0xFEEDFACF, machines[0], 0, 6) + bytes(16)
    heads = [struct.pack(">iiIII", machine, 0, 4096, 1, 12) for machine in machines]
    return struct.pack(">II", 0xCAFEBABE, len(machines)) + b"".join(heads)


THIRD_PARTY = {
    "AArch64 (64-bit ELF)": elf(183),
    "x86 (32-bit ELF)": elf(3, 32),
    "Arm (32-bit ELF)": elf(40, 32),
    "RISC-V (64-bit ELF)": elf(243),
    "PowerPC64 (64-bit ELF, big-endian)": elf(21, order=">"),
    "machine 4711 (64-bit ELF)": elf(4711),
    "x86-64 (PE)": pe(0x8664),
    "AArch64 (PE)": pe(0xAA64),
    "x86-64 (Mach-O)": mach_o(0x1000007),
    "AArch64 (Mach-O) and x86-64 (Mach-O)": mach_o(0x1000007, 0x100000C),
}
"""Libraries in the folder of linux64 that no Linux on x86-64 can load."""


@pytest.mark.skipif(machine.own() != {"x86-64 (64-bit ELF)"}, reason="for Linux on x86-64")
@pytest.mark.parametrize("kind", THIRD_PARTY)
def test_check_run_and_serve_name_the_machine_of_a_binary(packed, tmp_path, capsys, kind):
    path = packed(GOOD, {BINARY: THIRD_PARTY[kind]})
    line = f"{BINARY} is for {kind}, this machine loads x86-64 (64-bit ELF)"
    whole = str(write(tmp_path / "x.ssp", TOP, {"gain": path}))
    for arguments in (
        ["check", str(path)],
        ["serve", str(path)],
        ["check", whole],
        ["run", whole, "-o", str(tmp_path / "x.csv")],
    ):
        assert main(arguments) == 1
        (reported,) = [s for s in capsys.readouterr().err.splitlines() if "warning: " not in s]
        assert "gain.fmu" in reported
        assert reported.endswith(f": {line}")


@pytest.mark.parametrize(
    "content",
    [b"", bytes(5000), b"\x7fELF", b"#!/bin/sh\n", b"MZ" + b"\xff" * 100, pe(0x8664)[:130]],
)
def test_a_binary_that_is_no_library_is_reported(packed, tmp_path, capsys, content):
    path = packed(GOOD, {BINARY: content})
    whole = str(write(tmp_path / "x.ssp", TOP, {"gain": path}))
    for arguments in (["check", str(path)], ["run", whole, "-o", str(tmp_path / "x.csv")]):
        assert main(arguments) == 1
        assert f"{BINARY} is not a shared library (neither ELF" in capsys.readouterr().err


def test_a_library_for_several_machines_is_for_each_of_them():
    assert machine.kinds(mach_o(0x1000007, 0x100000C)) == {"x86-64 (Mach-O)", "AArch64 (Mach-O)"}


def test_check_and_run_have_one_limit_of_size(packed, tmp_path, capsys, monkeypatch):
    """Two components of 2000 bytes each exceed 3000, one does not."""
    path = packed(GOOD)
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    monkeypatch.setattr("harness.system.problems.MAX_UNPACKED", 3 * size // 2)
    for count, status in ((1, 0), (2, 1)):
        parts = [component(f"g{i}", "gain") for i in range(count)]
        whole = str(write(tmp_path / "x.ssp", system("top", parts, []), {"gain": path}))
        for arguments in (["check", whole], ["run", whole, "-o", str(tmp_path / "x.csv")]):
            assert main(arguments) == status
            reported = capsys.readouterr().err
            assert (f"would unpack to {2 * size} bytes" in reported) == bool(status)


# ---- in a system


def test_run_states_the_warnings_once_and_runs(packed, tmp_path, caplog):
    text = with_fault(ODD["an undefined unit"]).replace('nominal="2"', 'nominal="0"')
    parts = [component("a", "gain"), component("b", "gain")]
    guid = text.replace("{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}", "gain")
    path = write(tmp_path / "x.ssp", system("top", parts, ["a.y b.u"]), {"gain": packed(guid)})
    result = run(path)
    assert len(result.time) == 4
    reported = [message for message in caplog.messages if message.startswith("gain.fmu: ")]
    assert len(reported) == 1
    assert "and 1 more (harness check lists them)" in reported[0]


def test_wiring_faults_are_shown_together_with_all_others(fmus, packed, tmp_path, capsys):
    """A fault of the description, one of an FMU, one of a missing file, and two of the wiring."""
    bad = packed(with_fault(FATAL["equal names"]))
    parts = [
        component("count", "counter"),
        component("twice", "integrator"),
        component("bad", "gain"),
        component("lost", "nowhere"),
    ]
    wires = [
        "count.n twice.w",
        "count.m twice.u",
        "gone.y twice.u",
        "bad.y twice.u",
        "lost.y bad.q",
    ]
    files = {"counter": fmus["counter"], "integrator": fmus["integrator"], "gain": bad}
    path = write(tmp_path / "x.ssp", system("top", parts, wires), files)
    assert main(["check", str(path)]) == 1
    lines = capsys.readouterr().err.splitlines()
    for required in (
        "twice.w: there is no such input",
        "count.m: there is no such output",
        "gone.y to twice.u: there is no component 'gone'",
        "bad: gain.fmu: k: two variables have this name",
        "component lost: resources/nowhere.fmu is not in the archive",
    ):
        assert sum(required in line for line in lines) == 1, (required, lines)
    assert not any("bad.q" in line or "no component 'bad'" in line for line in lines)
