# SPDX-License-Identifier: BSD-2-Clause
"""Files and arguments made to do harm: nothing is written outside, nothing takes longer than
seconds, nothing controls the terminal.
"""

from __future__ import annotations

import logging
import os
import re
import time
import warnings
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest

from harness.cli.app import main
from harness.errors import ArchiveError, ResultsError, StructureError, UsageError
from harness.files.archive import UnsafeXmlError, pack, parsed
from harness.results import files as result_files
from harness.results.result import Result
from harness.spelling import did_you_mean, file_stem, printable
from harness.ssp import reader
from harness.studies.variants import MAX_RUNS, combinations
from harness.system.graph import build_graph
from tests.harness.third_party_fmu import COUNTER, description
from tests.harness.third_party_ssp import component, system, write

COUNT = component("count", "counter", "n>", "t_last>")
GAIN = component("gain", "gain", "u<", "y>", "k=")


@contextmanager
def within(seconds):
    """Processor time of this process, which other programs on the machine do not lengthen."""
    began = time.process_time()
    yield
    assert time.process_time() - began < seconds


@pytest.fixture
def named(fmus, tmp_path):
    """A system with a name of its own, in a folder deep enough to climb out of."""

    def write_named(name, top=None):
        folder = tmp_path / "a" / "b" / "c"
        folder.mkdir(parents=True, exist_ok=True)
        path = write(folder / "x.ssp", top or system("top", [COUNT], []), fmus)
        with zipfile.ZipFile(path) as archive:
            content = {entry: archive.read(entry) for entry in archive.namelist()}
        old = content["SystemStructure.ssd"]
        content["SystemStructure.ssd"] = old.replace(b'name="third_party"', b'name="%s"' % name, 1)
        with zipfile.ZipFile(path, "w") as archive:
            for entry, data in content.items():
                archive.writestr(entry, data)
        return path

    return write_named


# ---- names that are paths


@pytest.mark.parametrize("name", [b"../../x", b"/tmp/x", b"..", b".", b".x", b"a\\b", b"a:b", b""])
def test_the_name_of_a_system_is_no_path(named, tmp_path, monkeypatch, name):
    path = named(name)
    monkeypatch.chdir(path.parent)
    before = set(tmp_path.rglob("*"))
    assert main(["draw", "x.ssp"]) == 0
    assert main(["export", "x.ssp", "out"]) == 0
    new = set(tmp_path.rglob("*")) - before
    assert {p.suffix for p in new} == {".svg", ".ssp", ""}
    assert len(new) == 3
    assert all(p.parent in (path.parent, path.parent / "out") for p in new)
    assert not any(p.name.startswith(".") for p in new)


def test_a_name_that_is_none_gets_one():
    assert file_stem("../../x") == "_.._x"
    assert file_stem("...") == "system"
    assert file_stem("sync_approach") == "sync_approach"
    assert len(file_stem("x" * 5000)) == 100


def test_an_archive_with_names_that_are_paths_is_not_written(tmp_path):
    with pytest.raises(ArchiveError, match="a path that leaves the archive"):
        pack(tmp_path / "x.ssp", {"resources/sets/../../x.ssv": b""})
    assert list(tmp_path.iterdir()) == []


def test_a_link_planted_beside_is_not_followed(tmp_path, monkeypatch):
    """Even if its name were foreseen."""
    monkeypatch.setattr("secrets.token_hex", lambda _n: "0" * 12)
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / f".x-{os.getpid()}-{'0' * 12}.ssp").symlink_to(victim)
    with pytest.raises(ResultsError, match="File exists"):
        pack(tmp_path / "x.ssp", {"a": b"b"})
    assert victim.read_text() == "mine"


# ---- archives and encodings


def test_two_entries_of_one_name_are_rejected(fmus, tmp_path):
    path = write(tmp_path / "x.ssp", system("top", [COUNT], []), fmus)
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("SystemStructure.ssd", "<other/>")
    with pytest.raises(ArchiveError, match="two files of one name"), reader.opened(path):
        pass


def test_the_limit_of_size_holds_for_the_run_not_for_each_archive(fmus, tmp_path, monkeypatch):
    """Ten components of one FMU that lies in the archive once."""
    parts = [component(f"c{i}", "counter") for i in range(10)]
    path = write(tmp_path / "x.ssp", system("top", parts, []), fmus)
    with zipfile.ZipFile(fmus["counter"]) as archive:
        one = sum(entry.file_size for entry in archive.infolist())
    with reader.opened(path) as found:
        monkeypatch.setattr("harness.system.problems.MAX_UNPACKED", 10 * one)
        assert len(build_graph(found).nodes) == 10
        monkeypatch.setattr("harness.system.problems.MAX_UNPACKED", 10 * one - 1)
        with pytest.raises(StructureError, match=f"would unpack to {10 * one} bytes"):
            build_graph(found)


LAUGH = '<!DOCTYPE x [<!ENTITY a "ha">]><x>&a;</x>'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-7"])
def test_no_encoding_hides_a_document_type(encoding):
    text = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?>{LAUGH}'
    data = text.encode(encoding)
    if encoding == "utf-7":
        head, body = text.split("?>", 1)
        data = head.encode() + b"?>" + body.replace("<", "+ADw-").encode()
        assert b"<!DOCTYPE" not in data
    with pytest.raises(UnsafeXmlError):
        parsed(data)


@pytest.mark.parametrize("encoding", ["cp037", "utf-32"])
def test_an_encoding_that_is_not_like_ascii_is_not_parsed(encoding):
    with pytest.raises(UnsafeXmlError):
        parsed(f'<?xml version="1.0" encoding="{encoding}"?>{LAUGH}'.encode(encoding))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1", "cp1252"])
def test_usual_encodings_are_read(encoding):
    text = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?><x name="\xfc"/>'
    declared = text.replace("cp1252", "windows-1252")
    assert parsed(declared.encode(encoding)).get("name") == "\xfc"


def test_check_parses_nothing_before_the_document_type_is_rejected(tmp_path, monkeypatch, capsys):
    def never(*_arguments, **_options):
        raise AssertionError("it was parsed")

    monkeypatch.setattr("fmpy.model_description.read_model_description", never)
    monkeypatch.setattr("harness.system.interface.read_model_description", never)
    monkeypatch.setattr("harness.files.archive.etree.fromstring", never)
    with zipfile.ZipFile(tmp_path / "x.fmu", "w") as archive:
        text = description(COUNTER).replace("?>", "?><!DOCTYPE x>", 1)
        archive.writestr("modelDescription.xml", text)
    assert main(["check", str(tmp_path / "x.fmu")]) == 1
    assert "document type declaration" in capsys.readouterr().err


@pytest.mark.parametrize("kind", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_damaged_entry_is_one_line_for_any_compression(tmp_path, capsys, kind):
    path = tmp_path / "x.fmu"
    with zipfile.ZipFile(path, "w", kind) as archive:
        archive.writestr("modelDescription.xml", "<a>" + str(list(range(9999))) + "</a>")
    data = bytearray(path.read_bytes())
    data[80:200] = bytes(x ^ 0x55 for x in data[80:200])
    path.write_bytes(data)
    assert main(["check", str(path)]) == 1
    assert "damaged or not a zip archive" in capsys.readouterr().err


def test_a_full_disk_is_not_called_a_damaged_archive(fmus, tmp_path, monkeypatch):
    def full(*_arguments):
        raise OSError(28, "No space left on device")

    path = write(tmp_path / "x.ssp", system("top", [COUNT], []), fmus)
    monkeypatch.setattr("zipfile.ZipFile.extractall", full)
    with pytest.raises(ArchiveError) as caught, reader.opened(path):
        pass
    line = re.escape(f"{path}: cannot be unpacked") + r" into /\S+ \(No space left on device\)"
    assert re.fullmatch(line, str(caught.value))


# ---- time


def doubled(levels):
    """Systems in systems; each connector of a pair drives both connectors of the next pair."""
    inner = component("gain", "gain", "u<", "y>")
    wires = ["u1 gain.u", "u2 gain.u"]
    for level in range(levels):
        inner = system(f"s{level}", [inner], wires, "u1<", "u2<")
        wires = [f"u{i} s{level}.u{j}" for i in (1, 2) for j in (1, 2)]
    wires = [f"count.n s{levels - 1}.u{j}" for j in (1, 2)]
    return system("top", [COUNT, inner], wires)


def test_pairs_of_nested_connectors_end_in_seconds_with_a_reason(fmus, tmp_path, capsys):
    """2^40 ways from the top to the bottom."""
    path = write(tmp_path / "x.ssp", doubled(40), fmus)
    with within(5):
        assert main(["check", str(path)]) == 1
    assert "is driven" in capsys.readouterr().err


def test_parameters_through_pairs_of_nested_connectors_end_in_seconds(fmus, tmp_path):
    values = (
        '<d:ParameterBinding><d:ParameterValues><v:ParameterSet version="1.0" name="x">'
        '<v:Parameters><v:Parameter name="s39.u1"><v:Real value="1"/></v:Parameter>'
        "</v:Parameters></v:ParameterSet></d:ParameterValues></d:ParameterBinding>"
    )
    top = doubled(40).replace("<d:Elements>", f"<d:ParameterBindings>{values}"
                              "</d:ParameterBindings><d:Elements>", 1)  # fmt: skip
    path = write(tmp_path / "x.ssp", top, fmus)
    with within(5), reader.examined(path) as (_, problems):
        assert any("is driven 2 times" in problem for problem in problems)


def test_a_long_chain_of_connectors_is_rejected_not_a_recursion(fmus, tmp_path):
    passing = [system(f"p{i}", [], ["u y"], "u<", "y>") for i in range(2000)]
    passing = [p.replace("<d:Elements></d:Elements>", "") for p in passing]
    wires = ["count.n p0.u", *(f"p{i}.y p{i + 1}.u" for i in range(1999)), "p1999.y gain.u"]
    path = write(tmp_path / "x.ssp", system("top", [COUNT, GAIN, *passing], wires), fmus)
    with within(10), reader.examined(path) as (_, problems):
        assert any("has more than 200 connections" in problem for problem in problems)


def test_100_000_components_are_rejected_in_seconds(fmus, tmp_path):
    one = '<d:Component name="c{}" source="resources/counter.fmu"/>'
    parts = [one.format(i) for i in range(100_000)]
    path = write(tmp_path / "x.ssp", system("top", parts, []), fmus)
    with (
        within(20),
        pytest.raises(StructureError, match="100000 components, more than the limit of 10000"),
        reader.opened(path),
    ):
        pass


def test_3000_components_are_checked_in_seconds(fmus, tmp_path):
    parts = [component(f"g {i % 7}.{i}", "gain", "u<", "y>") for i in range(3000)]
    path = write(tmp_path / "x.ssp", system("top", parts, []), fmus)
    with within(30), reader.opened(path) as found:
        assert len(build_graph(found).nodes) == 3000


def test_1000_misspelt_connections_are_all_named_in_seconds(fmus, tmp_path, capsys):
    parts = [component(f"component_{i:04d}", "gain", "u<", "y>") for i in range(1000)]
    wires = [f"component_{i:04d}.y componemt_{i:04d}.u" for i in range(1000)]
    path = write(tmp_path / "x.ssp", system("top", parts, wires), fmus)
    with within(30):
        assert main(["check", str(path)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 1000
    assert all(f"close: component_{i:04d}" in lines[i] for i in (0, 500, 999))


def test_close_matches_match_difflib_among_few_and_among_many():
    many = [f"component_{i:04d}" for i in range(1000)]
    assert did_you_mean("componemt_0123", many).startswith(" (close: component_0123")
    assert did_you_mean("gian", ["gain", "main"]) == " (close: gain)"
    with within(1):
        assert did_you_mean("x" * 5000, ["x" * 4999] * 100) == ""


@pytest.mark.parametrize("count", [1000, pytest.param(10_000, marks=pytest.mark.long)])
def test_thousands_of_parameters_are_written_and_read_in_seconds(tmp_path, count):
    names = tuple(f"c.p{i}" for i in range(count))
    values = np.arange(float(count))[None]
    fixed = Result("s", np.zeros(1), names, ("m",) * count, values, ("text",) * count)
    run = Result("s", np.arange(3.0), ("c.y",), ("s",), np.ones((3, 1)), ("",), True, "", fixed)
    with within(40):
        result_files.ResultFile(tmp_path / "x.nc").write(run)
        back = result_files.read(tmp_path / "x.nc")
    assert back.parameter("c.p777") == 777
    assert back.parameters.unit("c.p777") == "m"
    assert back["c.y"].tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    "varied",
    [
        [("set", "a.k=0:1:1e-7")],
        [("set", "a.k=0:1:1e-300")],
        [("set", "a.k=0:1:1e-3"), ("set", "a.l=0:1:1e-3")],
        [("set", f"a.{name}=0:9:1") for name in "abcdefghij"],
    ],
)
def test_too_many_runs_are_rejected_at_once(varied):
    with within(2), pytest.raises(UsageError, match=f"(limit of|at most) {MAX_RUNS}"):
        combinations({}, varied)


def test_as_many_runs_as_allowed_are_made_in_seconds():
    with within(5):
        assert len(combinations({}, [("set", f"a.k=1:{MAX_RUNS}:1")])) == MAX_RUNS


# ---- control characters


def test_printed_text_cannot_control_a_terminal():
    assert printable("\xfc \u03c9 [1]\n\t") == "\xfc \u03c9 [1]\n\t"
    assert printable("a\x1b[2Jb\x07\x9b") == "a\\x1b[2Jb\\x07\\x9b"
    assert printable("a\u202eb\u200b") == "a\\u202eb\\u200b"
    assert printable("a\rb") == "a\\x0db"


def test_names_with_control_characters_are_shown_harmless(named, monkeypatch, capsys):
    """XML 1.0 knows C1 controls: U+009B begins a command of the terminal."""
    path = named(b"evil&#x9b;2J&#x202e;", system("top", [COUNT], ["count.n a&#x9b;b.u"]))
    monkeypatch.chdir(path.parent)
    for arguments in (["list", "x.ssp"], ["check", "x.ssp"], ["draw", "x.ssp"]):
        main(arguments)
        captured = capsys.readouterr()
        for text in (captured.out, captured.err):
            assert not set(text) & {"\x9b", "\u202e", "\x1b"}


def test_notes_with_control_characters_are_shown_harmless(capsys, monkeypatch):
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    main(["list", "nowhere"])
    capsys.readouterr()
    logging.getLogger("harness").warning("reports %s", "\x1b[2J")
    assert capsys.readouterr().err == "harness: note: reports \\x1b[2J\n"


def test_a_text_that_xml_cannot_hold_is_rejected_by_export(fmus, tmp_path, capsys):
    path = write(tmp_path / "x.ssp", system("top", [component("m", "mixed")], []), fmus)
    arguments = ["--set", "m.label=a\x1bb"]
    assert main(["export", str(path), str(tmp_path / "out"), *arguments]) == 1
    reported = capsys.readouterr().err
    assert "contains a character that is not permitted in XML" in reported
    assert "internal error" not in reported
    assert "\x1b" not in reported
