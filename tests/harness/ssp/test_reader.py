# SPDX-License-Identifier: BSD-2-Clause
"""Reading .ssp files: what is damaged, unsafe or of third parties."""

from __future__ import annotations

import stat
import tempfile
import zipfile
from pathlib import Path

import pytest

from harness import run
from harness.errors import ArchiveError, StructureError
from harness.files.archive import unpack
from harness.ssp import reader as ssp
from harness.ssp.parameters import bare_ssv, read_ssv
from harness.system.model import Parameter

SSD = """<?xml version="1.0" encoding="UTF-8"?>
<d:SystemStructureDescription version="1.0" name="third_party"
    xmlns:d="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:o="http://opensimulationplatform.com/SSP/OSPAnnotations">
  <d:System name="top">
    <d:Elements>
      <d:Component name="count" source="resources/my%20counter.fmu"/>
      <d:Component name="twice" source="resources/gain.fmu">
        <d:Connectors><d:Connector name="u" kind="input"/></d:Connectors>
        <d:ParameterBindings>
          <d:ParameterBinding>
            <d:ParameterValues>
              <v:ParameterSet version="1.0" name="inline"><v:Parameters>
                <v:Parameter name="k"><v:Real value="3"/></v:Parameter>
              </v:Parameters></v:ParameterSet>
            </d:ParameterValues>
          </d:ParameterBinding>
        </d:ParameterBindings>
        <d:Annotations>
          <c:Annotation type="com.opensimulationplatform"><o:StepSizeHint
          value="1.0"/></c:Annotation>
        </d:Annotations>
      </d:Component>
    </d:Elements>
    <d:Connections>
      <d:Connection startElement="count" startConnector="n" endElement="twice" endConnector="u"/>
    </d:Connections>
  </d:System>
  <d:DefaultExperiment stopTime="4.0">
    <d:Annotations><c:Annotation type="com.opensimulationplatform">
      <o:Algorithm><o:FixedStepAlgorithm baseStepSize="0.5"/></o:Algorithm>
    </c:Annotation></d:Annotations>
  </d:DefaultExperiment>
</d:SystemStructureDescription>
"""


@pytest.fixture
def write(fmus, tmp_path):
    """Pack a description with the two FMUs it names."""

    def write_archive(text=SSD, leave_out=(), **further):
        files = {"SystemStructure.ssd": text}
        files["resources/my counter.fmu"] = fmus["counter"].read_bytes()
        files["resources/gain.fmu"] = fmus["gain"].read_bytes()
        path = tmp_path / "third_party.ssp"
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in (files | further).items():
                if name not in leave_out:
                    archive.writestr(name, data)
        return path

    return write_archive


def complaints(path):
    with pytest.raises(StructureError) as caught, ssp.opened(path):
        pass
    return list(caught.value.problems)


# ---- third-party files


def test_a_file_of_another_tool_runs_with_any_xml_prefixes(write):
    result = run(write())
    assert result.system == "third_party"
    assert result.time.tolist() == [k * 0.5 for k in range(9)]
    # Jacobi without our annotation; the hint of a step of 1.0 makes `twice` publish every other
    # macro step
    assert result["count.n"].tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8]
    assert result["twice.y"].tolist() == [0, 0, 0, 0, 6, 6, 12, 12, 18]


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "<d:Elements>",
            '<d:Elements><d:SignalDictionaryReference name="bus" dictionary="signals"/>',
            "SystemStructure.ssd, line 8: the SignalDictionaryReference of bus is not supported",
        ),
        (
            '<v:Real value="3"/>',
            '<v:Real value="NaN"/>',
            "component twice: parameter k: must not be NaN",
        ),
        (
            'Size="0.5"',
            'Size="often"',
            "FixedStepAlgorithm: baseStepSize='often' is not a finite number",
        ),
    ],
)
def test_unsupported_elements_are_rejected_not_ignored(write, old, new, problem):
    assert SSD.count(old) == 1
    assert complaints(write(SSD.replace(old, new))) == [f"third_party.ssp: {problem}"]


def test_a_description_that_breaks_the_schema_is_rejected_with_line_and_reason(write):
    (problem,) = complaints(write(SSD.replace('name="top"', "")))
    assert problem.startswith("third_party.ssp: SystemStructure.ssd, line 7: ")
    assert "The attribute 'name' is required but missing" in problem


def test_missing_files_are_named_all_at_once(write):
    assert complaints(write(leave_out=("resources/my counter.fmu", "resources/gain.fmu"))) == [
        "third_party.ssp: component count: resources/my%20counter.fmu is not in the archive",
        "third_party.ssp: component twice: resources/gain.fmu is not in the archive",
    ]
    assert complaints(write(leave_out="SystemStructure.ssd")) == [
        "third_party.ssp: the archive contains no SystemStructure.ssd"
    ]


def test_an_fmu_outside_the_archive_is_not_reached(write, fmus):
    outside = f"../../../../../../../..{fmus['gain']}"
    assert complaints(write(SSD.replace("resources/gain.fmu", outside))) == [
        f"third_party.ssp: component twice: {outside} is not in the archive"
    ]


def test_parameters_outside_the_archive_are_not_read(write, tmp_path):
    """No line states the content of the file, which is no XML."""
    (tmp_path / "secret.ssv").write_text("secret")
    outside = f"../../../../../../..{tmp_path}/secret.ssv"
    begin, end = SSD.index("<d:ParameterBinding>"), SSD.index("</d:ParameterBindings>")
    text = SSD[:begin] + f'<d:ParameterBinding source="{outside}"/>' + SSD[end:]
    assert complaints(write(text)) == [
        f"third_party.ssp: component twice: {outside} is not in the archive"
    ]


def test_external_entities_and_document_types_are_rejected(write, tmp_path):
    (tmp_path / "secret.txt").write_text("secret")
    entity = f'<!DOCTYPE x [<!ENTITY s SYSTEM "file://{tmp_path}/secret.txt">]>'
    text = SSD.replace("<d:SystemStructureDescription", entity + "<d:SystemStructureDescription", 1)
    assert complaints(write(text)) == [
        "third_party.ssp: SystemStructure.ssd: a document type declaration is not allowed"
    ]


# ---- damaged archives


def test_a_truncated_file_is_reported_in_one_clear_line(write):
    path = write()
    path.write_bytes(path.read_bytes()[:-300])
    with (
        pytest.raises(
            ArchiveError, match=r"third_party\.ssp: cannot be unpacked, the file is damaged"
        ) as caught,
        ssp.opened(path),
    ):
        pass
    assert "\n" not in str(caught.value)


def test_damage_inside_an_entry_is_noticed(write):
    path = write()
    data = bytearray(path.read_bytes())
    at = data.index(b"SystemStructureDescription version")
    data[at] ^= 1
    path.write_bytes(data)
    with pytest.raises(ArchiveError, match="Bad CRC-32"), ssp.opened(path):
        pass


def test_a_file_that_is_no_archive_or_not_there_is_reported_in_one_clear_line(tmp_path):
    (tmp_path / "text.ssp").write_text("hello")
    with pytest.raises(ArchiveError, match="not a zip file"), ssp.opened(tmp_path / "text.ssp"):
        pass
    with pytest.raises(ArchiveError, match="no such file"), ssp.opened(tmp_path / "gone.ssp"):
        pass


@pytest.fixture
def into(tmp_path):
    folder = tmp_path / "into"
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("../outside", "a path that leaves the archive"),
        ("a/../../outside", "a path that leaves the archive"),
        ("/etc/outside", "an absolute path"),
        ("C:/outside", "a name with an illegal character"),
        ("a\\outside", "a name with an illegal character"),
    ],
)
def test_an_unsafe_name_is_rejected_before_anything_is_written(tmp_path, into, name, reason):
    path = tmp_path / "evil.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("harmless", "first in the archive")
        archive.writestr(name, "evil")
    with pytest.raises(ArchiveError, match=f"rejected, it holds {reason}"):
        unpack(path, into)
    assert list(into.iterdir()) == []


def test_links_are_rejected(tmp_path, into):
    path = tmp_path / "evil.ssp"
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(ArchiveError, match="a link or special file: 'link'"):
        unpack(path, into)
    assert list(into.iterdir()) == []


def test_an_archive_that_unpacks_to_too_much_is_rejected_before_anything_is_written(
    tmp_path, into, monkeypatch
):
    path = tmp_path / "bomb.ssp"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("zeros", bytes(1_000_000))
    monkeypatch.setattr("harness.files.archive.MAX_UNPACKED", 999_999)
    with pytest.raises(
        ArchiveError, match="it would unpack to 1000000 bytes, more than the limit of 999999"
    ):
        unpack(path, into)
    assert list(into.iterdir()) == []
    monkeypatch.setattr("harness.files.archive.MAX_UNPACKED", 1_000_000)
    unpack(path, into)


def test_the_temporary_folder_is_removed_also_when_the_run_fails(write, tmp_path, monkeypatch):
    path = write()
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setenv("HARNESS_CACHE", "off")
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    with pytest.raises(ZeroDivisionError), ssp.opened(path):
        assert [p.stat().st_mode & 0o077 for p in scratch.iterdir()] == [0]  # private
        raise ZeroDivisionError
    assert list(scratch.iterdir()) == []
    with pytest.raises(StructureError):
        run(write(SSD.replace('endConnector="u"', 'endConnector="w"')))
    assert list(scratch.iterdir()) == []


# ---- .ssv


def test_parameters_of_all_types_are_read(tmp_path):
    path = tmp_path / "x.ssv"
    path.write_text(
        '<s:ParameterSet version="1.0" name="x" xmlns:s="http://ssp-standard.org/SSP1/SystemStructureParameterValues">'
        '<s:Parameters><s:Parameter name="r"><s:Real value="-INF" unit="m"/></s:Parameter>'
        '<s:Parameter name="i"><s:Integer value="7"/></s:Parameter>'
        '<s:Parameter name="b"><s:Boolean value="true"/></s:Parameter>'
        '<s:Parameter name="t"><s:String value="word"/></s:Parameter>'
        "</s:Parameters></s:ParameterSet>"
    )
    read = read_ssv(path)
    assert {name: parameter.value for name, parameter in read.items()} == {
        "r": -float("inf"),
        "i": 7,
        "b": True,
        "t": "word",
    }
    assert read["r"].unit == "m"


@pytest.mark.parametrize("value", [True, 2.5, "word"])
def test_a_parameter_of_an_alternative_is_read_as_it_was_given(tmp_path, value):
    path = tmp_path / "x.ssv"
    path.write_bytes(bare_ssv("x", {"own": Parameter(value)}, 1))
    assert read_ssv(path)["own"].value == value
    assert type(read_ssv(path)["own"].value) is type(value)


def test_a_private_folder_of_the_reader_is_not_the_callers_problem(write, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", "off")
    with ssp.opened(write()) as system:
        fmu = system.components[0].fmu
        assert fmu.is_file()
    assert not Path(fmu).exists()
