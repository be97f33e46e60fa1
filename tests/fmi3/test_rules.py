# SPDX-License-Identifier: BSD-2-Clause
"""Descriptions of FMI 3.0 with one fault each: it is named, and nothing else is."""

from __future__ import annotations

import zipfile

import pytest

from harness.conformance.check import examine
from harness.system.interface import read_interface

GOOD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="good" instantiationToken="{1}"
  variableNamingConvention="structured">
  <CoSimulation modelIdentifier="good" canGetAndSetFMUState="true"/>
  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/><DisplayUnit name="km" factor="0.001"/></Unit>
    <Unit name="s"><BaseUnit s="1"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <Float64Type name="Length" unit="m" min="-10" max="10"/>
    <EnumerationType name="Colour"><Item name="red" value="1"/><Item name="blue" value="2"/>
    </EnumerationType>
  </TypeDefinitions>
  <LogCategories><Category name="logEvents"/><Category name="logStatusError"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="10" stepSize="0.1" tolerance="1e-6"/>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"
      unit="s"/>
    <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed"
      start="3"/>
    <Float64 name="k" valueReference="2" causality="parameter" variability="fixed"
      start="2" min="0"/>
    <Float64 name="u" valueReference="3" causality="input" declaredType="Length" displayUnit="km"
      nominal="2" start="1 2 3"><Dimension valueReference="1"/><Alias name="other"/></Float64>
    <Enumeration name="c" valueReference="4" causality="input" declaredType="Colour" start="1"/>
    <Float64 name="y" valueReference="5" causality="output" unit="m">
      <Dimension start="3"/></Float64>
    <Boolean name="ready" valueReference="6" causality="output"/>
    <Float64 name="x" valueReference="7" unit="m" start="0" initial="exact"/>
    <Float64 name="der(x)" valueReference="8" derivative="7"/>
    <Clock name="tick" valueReference="9" causality="local" intervalVariability="triggered"/>
    <Float64 name="sampled" valueReference="10" variability="discrete" clocks="9"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="5" dependencies="3" dependenciesKind="dependent"/>
    <Output valueReference="6" dependencies=""/>
    <ContinuousStateDerivative valueReference="8"/>
    <InitialUnknown valueReference="5"/>
    <InitialUnknown valueReference="6"/>
    <InitialUnknown valueReference="8"/>
  </ModelStructure>
</fmiModelDescription>
"""
BUILD = """<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="good">
<SourceFileSet language="C99" compiler="gcc" compilerOptions="-O2"><SourceFile name="good.c"/>
</SourceFileSet></BuildConfiguration></fmiBuildDescription>
"""
TERMINALS = """<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
<Terminal name="plug" matchingRule="bus" terminalKind="a.b">
<TerminalMemberVariable variableName="u" memberName="u" variableKind="signal"/></Terminal>
<Terminal name="other" matchingRule="bus" terminalKind="a.b"/>
</Terminals></fmiTerminalsAndIcons>
"""
FILES = {
    "modelDescription.xml": GOOD,
    "sources/buildDescription.xml": BUILD,
    "sources/good.c": "",
    "terminalsAndIcons/terminalsAndIcons.xml": TERMINALS,
}
M, B, _, T = FILES
PLUG = TERMINALS[TERMINALS.index("<Terminal ") : TERMINALS.index("</Terminals>")]

ERRORS = {
    "no version": (M, ' fmiVersion="3.0"', "", "fmiVersion is missing"),
    "unknown version": (M, '"3.0"', '"4.0"', "FMI 4.0 is not supported"),
    "no token": (M, 'instantiationToken="{1}"', "", "instantiationToken"),
    "identifier is a path": (M, 'Identifier="good"', 'Identifier="../a"', "name of a library"),
    "two variables of a name": (M, 'name="k"', 'name="n"', "two variables have this name"),
    "empty name": (M, 'name="k"', 'name=" "', "has no name"),
    "undefined type": (M, '"Length" displ', '"Width" displ', "its type Width is not defined"),
    "unknown state": (M, 'derivative="7"', 'derivative="70"', "variable 70 does not exist"),
    "unknown output": (M, '<Output valueReference="6"', '<Output valueReference="66"',
                       "variable 66 does not"),
    "unknown dependency": (M, 'dependencies="3"', 'dependencies="33"', "variable 33 does not"),
    "item twice": (M, '"blue"', '"red"', "the name red is given twice"),
    "no independent": (M, 'causality="independent" variability="continuous"', "",
                       "one independent variable (usually time), got none"),
    "two independent": (M, '"x" valueReference="7" unit="m" start="0" initial="exact"',
                        '"x" valueReference="7" causality="independent"', "expected one"),
    "reference twice": (M, '"k" valueReference="2"', '"k" valueReference="3"',
                        "share the value reference 3"),
    "size of nobody": (M, '<Dimension valueReference="1"/>', '<Dimension valueReference="77"/>',
                       "must be a number or a structural parameter"),
    "size of a parameter": (M, '<Dimension valueReference="1"/>',
                            '<Dimension valueReference="2"/>', "or a structural parameter"),
    "size given twice": (M, '<Dimension start="3"/>', '<Dimension start="3" valueReference="1"/>',
                        "needs a start or a valueReference, and not both"),
    "size 0": (M, '<Dimension start="3"/>', '<Dimension start="0"/>', "has 0 elements"),
    "too large": (M, '<Dimension start="3"/>', '<Dimension start="3000000"/>', "has 3000000"),
    "two starts for three": (M, 'start="1 2 3"', 'start="1 2"', "3 elements and 2 start values"),
    "unknown clock": (M, 'clocks="9"', 'clocks="99"', "clocks: variable 99 does not exist"),
    "alias of a name": (M, '<Alias name="other"/>', '<Alias name="k"/>', "two variables"),
    "start is no number": (M, 'start="1 2 3"', 'start="1 2 x"', "line "),
    "unknown element": (M, "<LogCategories>", "<Logs/><LogCategories>", "Logs"),
}  # fmt: skip
WARNINGS = {
    "clock is none": (M, 'clocks="9"', 'clocks="7"', "must have type Clock"),
    "unknown previous": (M, 'clocks="9"', 'clocks="9" previous="77"', "value has the reference 77"),
    "clock as unknown": (M, '<InitialUnknown valueReference="8"/>',
                         '<InitialUnknown valueReference="8"/><InitialUnknown valueReference="9"/>',
                         "tick is a clock"),
    "type of another kind": (M, 'declaredType="Length"', 'declaredType="Colour"',
                             "is Float64, but its declared type is Enumeration"),
    "initial of time": (M, 'independent" variability="continuous"',
                        'independent" variability="continuous" initial="exact"',
                        "independent cannot have initial"),
    "nominal 0": (M, 'nominal="2"', 'nominal="0"', "nominal must not be 0"),
    "start outside": (M, 'start="1 2 3"', 'start="1 2 30"', "start 30 lies outside"),
    "start of an output": (M, '"y" valueReference="5" causality="output"',
                           '"y" valueReference="5" causality="output" start="1"', "is calculated"),
    "no start": (M, ' start="2" min="0"', ' min="0"', "has no start value"),
    "start that is no item": (M, '"Colour" start="1"', '"Colour" start="7"', "is not an item"),
    "limits crossed": (M, 'start="2" min="0"', 'start="2" min="0" max="-1"', "exceeds max"),
    "undefined unit": (M, 'causality="output" unit="m"', 'causality="output" unit="ft"',
                       "its unit ft is not defined"),
    "undefined display unit": (M, 'displayUnit="km"', 'displayUnit="au"', "display unit au"),
    "discrete parameter": (M, 'causality="parameter" variability="fixed"',
                           'causality="parameter" variability="discrete"', "cannot be discrete"),
    "continuous Boolean": (M, '"ready" valueReference="6"',
                           '"ready" valueReference="6" variability="continuous"',
                           "which cannot be continuous"),
    "unstructured name": (M, '"sampled"', '"sampled value"', "follow the naming convention"),
    "output not listed": (M, '<Output valueReference="6" dependencies=""/>', "",
                          "Output: must list ready"),
    "input listed": (M, '<Output valueReference="6" dependencies=""/>',
                     '<Output valueReference="6" dependencies=""/><Output valueReference="4"/>',
                     "must not list c"),
    "unknown of initialization": (M, '<InitialUnknown valueReference="6"/>', "",
                                  "InitialUnknown: must list ready"),
    "kinds without dependencies": (M, 'dependencies="3" ', "", "expected 0 dependency kinds"),
    "more kinds": (M, '"dependent"', '"dependent constant"', "expected 1 dependency kinds"),
    "stop before start": (M, 'stopTime="10"', 'stopTime="-1"', "must lie after"),
    "step of 0": (M, 'stepSize="0.1"', 'stepSize="0"', "stepSize 0 must be"),
    "empty token": (M, '"{1}"', '""', "instantiationToken is empty"),
    "unit twice": (M, '<Unit name="s">', '<Unit name="m">', "Unit (line 7): the name m"),
    "category twice": (M, '"logStatusError"', '"logEvents"', "the name logEvents is given twice"),
    "options without compiler": (B, ' compiler="gcc"', "", "compilerOptions without compiler"),
    "build of another": (B, '"good"', '"bad"', "modelIdentifier bad"),
    "source missing": (B, '"good.c"', '"bad.c"', "sources/bad.c is listed, but not"),
    "build against the schema": (B, "<SourceFile ", "<File ", "File"),
    "no terminals": (T, PLUG,
                     "", "Terminals is empty"),
    "member that is none": (T, 'variableName="u"', 'variableName="v"', "variable v does not"),
    "terminal twice": (T, 'name="other"', 'name="plug"', "the name plug is given twice"),
}  # fmt: skip


def written(folder, files):
    path = folder / "good.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def with_fault(folder, file, old, new):
    assert FILES[file].count(old) == 1, old
    return written(folder, {**FILES, file: FILES[file].replace(old, new)})


def test_a_description_without_a_fault_is_fine(tmp_path):
    path = written(tmp_path, FILES)
    found = examine(path)
    assert (found.errors, found.warnings) == ((), ())
    assert read_interface(path).variables["u[3]"].start == 3.0


def test_there_are_forty():
    assert len(ERRORS) + len(WARNINGS) >= 40


@pytest.mark.parametrize("fault", ERRORS)
def test_an_error_is_named(tmp_path, fault):
    *edit, words = ERRORS[fault]
    found = examine(with_fault(tmp_path, *edit))
    assert any(words in line for line in found.errors), found


@pytest.mark.parametrize("fault", WARNINGS)
def test_a_warning_is_named(tmp_path, fault):
    *edit, words = WARNINGS[fault]
    found = examine(with_fault(tmp_path, *edit))
    assert found.errors == ()
    assert any(words in line for line in found.warnings), found


def test_stray_files_match_fmi_3(tmp_path):
    found = examine(written(tmp_path, {**FILES, "model.png": "", "licenses/a.txt": ""}))
    assert [line.split(":")[0] for line in found.warnings] == ["model.png", "licenses"]
