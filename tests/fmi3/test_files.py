# SPDX-License-Identifier: BSD-2-Clause
"""Content of the archives of FMI 3.0: by the schemas, complete, in agreement with FMI 2.0."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest
from lxml import etree

from tests.compliance import description
from tests.compliance.fmus import BUILD, ROOT
from tests.each import Each
from tests.fmi3 import probe
from tests.fmi3.fmus import ARCHIVES
from tests.validators import problems

SCHEMAS = Path(fmpy.__file__).parent / "schema/fmi3"
HEADERS = Path(fmpy.__file__).parent / "c-code"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
MUST = {
    "modelDescription.xml",
    "documentation/index.html",
    "documentation/model.png",
    "documentation/licenses/license.txt",
    "sources/buildDescription.xml",
}
MAY = re.compile(
    r"extra/org\.fmi-standard\.fmi-ls-ref/(fmi-ls-manifest\.xml|reference\.csv)|"
    r"sources/\w+\.[ch]|binaries/[\w-]+/\w+\.(so|dll|dylib)|terminalsAndIcons/(terminalsAndIcons\.xml|(icon|input|output)\.png)"
)


@pytest.fixture(scope="module")
def archive():
    return Each(ARCHIVES, lambda path: path.stem)


@cache
def read(path):
    with zipfile.ZipFile(path) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


@cache
def schema(name):
    return etree.XMLSchema(file=str(SCHEMAS / f"fmi3{name}.xsd"))


def findings(name, text):
    tree = etree.fromstring(text)
    return [] if schema(name).validate(tree) else list(schema(name).error_log)


def test_the_archive_has_its_files_and_nothing_else(archive):
    names = set(read(archive))
    assert names >= MUST
    assert [name for name in names - MUST if not MAY.fullmatch(name)] == []


def test_no_file_states_where_it_was_built(archive):
    if any(b"__asan_init" in data for data in read(archive).values()):
        pytest.skip("sanitised libraries hold the paths of their sources for their reports")
    assert [name for name, data in read(archive).items() if str(ROOT).encode() in data] == []


def test_descriptions_are_by_the_schemas(archive):
    files = read(archive)
    assert findings("ModelDescription", files["modelDescription.xml"]) == []
    assert findings("BuildDescription", files["sources/buildDescription.xml"]) == []
    terminals = files.get("terminalsAndIcons/terminalsAndIcons.xml")
    assert terminals is None or findings("TerminalsAndIcons", terminals) == []


def test_a_description_against_the_schema_would_be_seen():
    text = read(ARCHIVES[0])["sources/buildDescription.xml"]
    assert findings("BuildDescription", text.replace(b"SourceFile ", b"File "))


def test_fmpy_finds_nothing(archive):
    assert problems(archive) == []


def test_the_description_states_what_the_one_of_fmi_2_states(archive):
    """Rows, units, limits, start values, texts, token."""
    root = ElementTree.fromstring(read(archive)["modelDescription.xml"])
    about = description.read(BUILD / "fmus" / archive.name)
    assert root.attrib["instantiationToken"] == about.guid
    shown = ("causality", "unit", "description")
    for variable in root.find("ModelVariables"):
        if variable.attrib["causality"] == "independent":
            continue
        elements = [v for v in about.variables if v.row == variable.attrib["name"]]
        size = 1
        for dimension in variable.iter("Dimension"):
            size *= int(dimension.attrib["start"])
        assert len(elements) == size, variable.attrib["name"]
        first = elements[0]
        assert int(variable.attrib["valueReference"]) == first.reference
        reported = [variable.get(name) for name in shown]
        assert reported == [first.causality, first.unit, first.text]
        starts = [v.start for v in elements if v.start is not None]
        assert list(map(float, variable.get("start", "").split())) == starts


def test_flags_are_discrete_numbers_of_a_type(archive):
    root = ElementTree.fromstring(read(archive)["modelDescription.xml"])
    for variable in root.iter("Float64"):
        flag = variable.get("declaredType") == "Flag"
        assert flag == ((variable.get("min"), variable.get("max")) == ("0", "1"))
        if flag and variable.attrib["causality"] != "parameter":
            assert variable.attrib["variability"] == "discrete"


def test_sources_are_listed_and_of_this_version_only(archive):
    files = read(archive)
    listed = re.findall(rb'SourceFile name="([^"]+)"', files["sources/buildDescription.xml"])
    there = [name.removeprefix("sources/").encode() for name in files if name.endswith(".c")]
    assert sorted(listed) == sorted(there)
    assert not [name for name in files if "fmi2" in name]


def test_plugs_hold_variables(archive):
    files = read(archive)
    text = files.get("terminalsAndIcons/terminalsAndIcons.xml")
    if text is None:
        pytest.skip(f"{archive.stem} has no inputs and outputs")
    root = ElementTree.fromstring(files["modelDescription.xml"])
    causality = {e.attrib["name"]: e.get("causality") for e in root.find("ModelVariables")}
    terminals = list(ElementTree.fromstring(text).iter("Terminal"))
    assert terminals
    for terminal in terminals:
        members = [e.attrib["variableName"] for e in terminal.iter("TerminalMemberVariable")]
        direction = terminal.attrib["name"].rpartition("_")[2]
        assert members
        drawn = terminal.find("TerminalGraphicalRepresentation").attrib
        assert f"terminalsAndIcons/{drawn['iconBaseName']}.png" in files
        assert {causality[name] for name in members} == {f"{direction}put"}


def test_the_target_has_a_plug():
    target = next((path for path in ARCHIVES if path.stem == "target"), None)
    if target is None:
        pytest.skip("target is not built")
    text = read(target)["terminalsAndIcons/terminalsAndIcons.xml"].decode()
    state = text.partition('name="TN_out"')[2].partition("</Terminal>")[0]
    members = re.findall(r'variableName="(\w+)" memberName="(\w+)"', state)
    assert dict(members) == {
        "r_TN_N": "r",
        "v_TN_N": "v",
        "q_TN": "q",
        "omega_TN_T": "omega",
    }


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
def test_sources_alone_give_the_bits_of_the_binary(tmp_path):
    """The build description is all that is needed."""
    for path in [p for p in ARCHIVES if p.stem in ("ideal_propulsion", "pid_controller")]:
        folder = tmp_path / f"{path.stem}-compiled"
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        build = ElementTree.parse(folder / "sources/buildDescription.xml")
        sources = build.find("BuildConfiguration/SourceFileSet")
        names = [e.attrib["name"] for e in sources.iter("SourceFile")]
        library = folder / "binaries" / probe.FOLDER / f"{path.stem}{probe.ENDING}"
        library.unlink()
        flags = [*sources.attrib["compilerOptions"].split(), "-fPIC", "-shared", "-Wall", "-Werror"]
        command = [COMPILER, *flags, "-isystem", HEADERS, *names, "-o", library, "-lm"]
        subprocess.run(command, check=True, cwd=folder / "sources")
        recordings = [
            recording(probe.Fmu(archive, tmp_path / f"{path.stem}-{i}"))
            for i, archive in enumerate((path, repacked(folder, path.name)))
        ]
        assert recordings[0] == recordings[1]


def recording(fmu):
    """The bits of ten steps."""
    with probe.Instance(fmu) as one:
        return one.start().simulate(10)


def repacked(folder, name):
    """The folder of an FMU as an archive."""
    path = folder.parent / "again" / name
    path.parent.mkdir(exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for file in folder.rglob("*"):
            archive.write(file, file.relative_to(folder))
    return path


def test_the_probe_runs_as_a_program():
    command = [sys.executable, ROOT / "tests/fmi3/probe.py", ARCHIVES[0]]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-1].endswith(": 0 fail"), done.stdout + done.stderr
