# SPDX-License-Identifier: BSD-2-Clause
"""Resource meta data (.srmd): by the schema of SSP Traceability, true, and the same every time."""

from __future__ import annotations

import hashlib
import importlib.util
import shutil
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
import xmlschema

from harness import load, run
from harness.files import paths
from harness.master.changes import apply
from harness.mission.claim import Row
from harness.ssp.writer import write_ssp
from tests.site.scripts import script

SPACE = "{http://ssp-standard.org/SSPTraceability1/SSPTraceabilityCommon}"
XLINK = "http://www.w3.org/1999/xlink"
NAMES = ("type", "href", "role", "arcrole", "title", "show", "actuate", "label", "from", "to")
SOURCE = {"name": "Vallado", "where": "", "licence": ""}
ROWS = [
    Row("vallado-2-6", "start", SOURCE, "r_TN_N", 9e-10, 1e-6, "m"),
    Row("vallado-2-6", "start", SOURCE, "v_TN_N", 2e-9, 1e-9, "m/s"),
    Row("vallado-2-4", "orbit", SOURCE, "r_TN_N", 1e-7, 1e-4, "m"),
    Row("basilisk-wheels", "wheels", SOURCE, "C", 7e-8, 3e-7, "rad"),
]
ENTRIES = [
    "vallado-2-6 (Vallado): r_TN_N 9e-10 of 1e-06 m; v_TN_N 2e-09 of 1e-09 m/s; DIFFERS",
    "vallado-2-4 (Vallado): r_TN_N 1e-07 of 0.0001 m; agrees",
]


@pytest.fixture(scope="module")
def traceability():
    return script("traceability")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The two archives of one model, as a build has them."""
    place = tmp_path_factory.mktemp("build")
    for kind in ("fmus", "fmus3"):
        (place / kind).mkdir()
        shutil.copy(paths.fmus()["target"].parents[1] / kind / "target.fmu", place / kind)
    return place


@pytest.fixture(scope="module")
def schema(tmp_path_factory):
    """Schema of a package, with a replacement for the schema of links, which it would fetch."""
    links = tmp_path_factory.mktemp("schema") / "xlink.xsd"
    attributes = "".join(f'<xs:attribute name="{name}" type="xs:string"/>' for name in NAMES)
    links.write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" '
        f'targetNamespace="{XLINK}">{attributes}</xs:schema>',
        encoding="utf-8",
    )
    package = Path(importlib.util.find_spec("pyssp_standard").origin).parent
    file = package / "resources/SRMD11.xsd"
    return xmlschema.XMLSchema11(str(file), locations={XLINK: str(links)}, allow="local")


def entries(data, keyword):
    table = ElementTree.fromstring(data).iter(f"{SPACE}ClassificationEntry")
    return [entry.text for entry in table if entry.get("keyword") == keyword]


def test_files_are_valid_and_a_wrong_one_would_not_be(traceability, folder, schema):
    found = traceability.contents(folder, ROWS)
    assert sorted(found) == ["target.fmi3.srmd", "target.srmd"]
    for data in found.values():
        assert [e.reason for e in schema.iter_errors(data.decode())] == []
        assert list(schema.iter_errors(data.decode().replace("checksum=", "sum=")))


def test_an_fmu_is_reported_by_its_hash_its_sources_and_its_cases(traceability, folder):
    for name, data in traceability.contents(folder, ROWS).items():
        root = ElementTree.fromstring(data)
        content = (folder / root.attrib["data"]).read_bytes()
        assert bytes.fromhex(root.attrib["checksum"]) == hashlib.sha3_256(content).digest()
        assert entries(data, "validation.case") == ENTRIES
        assert "Source: Zhu & Yang 2009" in entries(data, "source.equations")[0]
        assert len(entries(data, "source.sha256")) == 1
        assert len(entries(data, "build.compiler")) == ("fmi3" in name)


def test_the_evidence_of_a_parameter_set_equals_the_report_of_its_run(traceability, schema):
    system = paths.systems()["sync_approach"]
    about = traceability.about_set(system, "default")
    data = traceability.srmd("x", "ssp/x.ssp", system.read_bytes(), "parameters", about)
    assert list(schema.iter_errors(data.decode())) == []
    assert entries(data, "run") == ["complete"]
    verdicts = entries(data, "requirement.verdict")
    assert [v.partition(" (")[0] for v in verdicts][:2] == ["NOT MET: distance", "met: tracking"]
    claims = entries(data, "claim.verdict")
    assert any(text.endswith(": arrival: reproduced") for text in claims)


@pytest.fixture
def systems(tmp_path):
    """One system under two names, and with another end."""
    folder = tmp_path / "ssp"
    folder.mkdir()
    with load("sync_approach") as system:
        for name, changes in (("a.fmi3", {}), ("a", {}), ("b", {"stop": 900.0})):
            write_ssp(apply(system, **changes), folder / f"{name}.ssp")
    return tmp_path


def test_the_same_system_with_fmus_of_the_other_fmi_is_not_run_again(
    traceability, systems, monkeypatch
):
    simulated = []

    def about_set(path, params):
        simulated.append((path.stem, params))
        return [("run", f"{path.stem} {params}")]

    monkeypatch.setattr(traceability, "about_set", about_set)
    found = traceability.contents(systems, ROWS)
    assert sorted(simulated) == sorted({*simulated})
    assert {name for name, _ in simulated} == {"a", "b"}
    assert entries(found["a.fmi3.robust.srmd"], "run") == ["a robust"]
    of = {name: entries(found[f"{name}.default.srmd"], "run.of") for name in ("a", "a.fmi3", "b")}
    assert of == {"a": [], "a.fmi3": ["a.ssp"], "b": []}


def test_unless_its_run_begins_with_other_bits(traceability, systems, monkeypatch):
    def other(path, **changes):
        also = {"servicer.mass_0": 99.0} if path.stem == "a.fmi3" else {}
        return run(path, **changes, set=also)

    monkeypatch.setattr(traceability, "run", other)
    files = [systems / "ssp" / f"{name}.ssp" for name in ("a", "a.fmi3")]
    assert traceability.representatives(files) == dict(zip(files, files, strict=True))


def test_the_command_packs_the_same_bytes_again(traceability, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(traceability, "validate", lambda: ROWS)
    written = []
    for name in ("a.zip", "b.zip"):
        monkeypatch.setattr(sys, "argv", ["x", str(folder), "-o", str(tmp_path / name)])
        traceability.main()
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert sorted(archive.namelist()) == ["target.fmi3.srmd", "target.srmd"]
