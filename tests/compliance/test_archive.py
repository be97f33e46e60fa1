# SPDX-License-Identifier: BSD-2-Clause
"""The files inside an .fmu: what must be there, and nothing else."""

from __future__ import annotations

import re
import stat
import zipfile
from functools import cache
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath

import fmpy
import pytest

from tests.compliance import api, png
from tests.compliance.fmus import ROOT
from tests.compliance.probe import ENDING, FOLDER

STANDARD_HEADERS = {"fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"}
FMI3_FUNCTIONS = set(
    re.findall(
        r"define (fmi3\w+) +fmi3FullName",
        (Path(fmpy.__file__).parent / "c-code/fmi3Functions.h").read_text(encoding="utf-8"),
    )
)
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
ENDINGS = {"linux64": "so", "win64": "dll", "darwin64": "dylib", "aarch64-darwin": "dylib"}


@pytest.fixture(scope="session")
def files(archive):
    """Contents by name."""
    return archive.map(read)


@cache
def read(archive):
    with zipfile.ZipFile(archive) as opened:
        return {entry.filename: opened.read(entry) for entry in opened.infolist()}


@pytest.fixture(scope="session")
def sources(files):
    """Texts of the source files by name."""
    return files.map(
        lambda files: {
            name.removeprefix("sources/"): data.decode()
            for name, data in files.items()
            if name.startswith("sources/")
        }
    )


def is_expected(path, fmu):
    folder, _, name = path.rpartition("/")
    if folder.startswith("binaries/"):
        return name == f"{fmu}.{ENDINGS.get(folder.removeprefix('binaries/'))}"
    allowed = {
        "": r"modelDescription\.xml|model\.png",
        "documentation": r"index\.html|[\w-]+\.(png|svg)",
        "licenses": r"license\.txt",
        "sources": r"\w+\.[ch]",
        "extra/org.fmi-standard.fmi-ls-ref": r"fmi-ls-manifest\.xml|reference\.csv",
    }
    return folder in allowed and re.fullmatch(allowed[folder], name) is not None


def test_there_is_no_stray_file(archive, files):
    assert [path for path in files if not is_expected(path, archive.stem)] == []


@pytest.mark.parametrize(
    "stray",
    [
        "notes.txt",
        "sources/.x.c.swp",
        "binaries/linux64/other.so",
        "sources/a/b.c",
        "binaries/a.so",
    ],
)
def test_a_stray_file_would_be_noticed(stray):
    assert not is_expected(stray, "target")


def test_entries_are_plain_files_with_relative_names_and_a_fixed_date(archive):
    with zipfile.ZipFile(archive) as opened:
        entries = opened.infolist()
        assert opened.testzip() is None
    assert len({entry.filename for entry in entries}) == len(entries)
    for entry in entries:
        path = PurePosixPath(entry.orig_filename)
        assert "\\" not in entry.orig_filename
        assert not path.is_absolute()
        assert ".." not in path.parts
        assert not entry.is_dir()
        assert stat.S_IFMT(entry.external_attr >> 16) in (0, stat.S_IFREG)
        assert entry.date_time == (1980, 1, 1, 0, 0, 0), (
            "the first date of zip archives, not the date of the build"
        )


def test_files_that_fmi_and_readers_expect_are_present(archive, files):
    for required in (
        "modelDescription.xml",
        "model.png",
        "documentation/index.html",
        "licenses/license.txt",
    ):
        assert files[required]
    assert files[f"binaries/{FOLDER}/{archive.stem}{ENDING}"]


# ---- sources


def test_every_listed_source_is_there_and_every_c_file_is_listed(about, sources):
    listed = [e.attrib["name"] for e in about.root.findall("CoSimulation/SourceFiles/File")]
    assert sorted(listed) == sorted(name for name in sources if name.endswith(".c"))


def test_sources_include_only_each_other_and_the_fmi_headers(sources):
    included = {name for text in sources.values() for name in INCLUDE.findall(text)}
    assert included <= set(sources) | STANDARD_HEADERS
    assert not STANDARD_HEADERS & set(sources), (
        "the headers of FMI come with the tool that compiles"
    )


def test_sources_retain_away_from_the_process_and_its_files(sources):
    """An FMU never exits, aborts, prints to the terminal, opens a file or has static variables."""
    forbidden = re.compile(
        r"\b(exit|abort|_Exit|assert|printf|puts|putchar|fopen|system|setlocale|getenv)\s*\("
    )
    assert [
        (name, found) for name, text in sources.items() for found in forbidden.findall(text)
    ] == []
    variable = re.compile(r"^\s*static (?!const|inline)[^(\n]*[=;]", re.MULTILINE)
    assert [
        (name, found) for name, text in sources.items() for found in variable.findall(text)
    ] == []


# ---- the library


def test_the_library_exports_the_fmi_functions_and_nothing_else(symbols):
    exported = {name for name, letter in symbols.items() if letter not in "Uw"}
    assert (
        exported
        - {name for name in exported if name.startswith(("__asan", "__ubsan", "__odr_asan"))}
        == set(api.FUNCTIONS) | FMI3_FUNCTIONS
    )


def test_no_file_states_where_it_was_built(files):
    if any(b"__asan_init" in data for data in files.values()):
        pytest.skip("sanitised libraries hold the paths of their sources for their reports")
    assert [name for name, data in files.items() if str(ROOT).encode() in data] == []


# ---- documentation, licence, picture


class Page(HTMLParser):
    """Text, pictures, equations as they are in the source, and balance of the tags of a page."""

    def __init__(self, page):
        super().__init__()
        self.open, self.words, self.pictures, self.equations = [], [], [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.pictures.append(dict(attrs)["src"])
        elif tag != "meta":
            self.open.append(tag)
        if tag == "math":
            self.equations.append(dict(attrs)["alttext"])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data.strip())


def test_the_documentation_is_a_page_that_describes_every_port(about, files):
    page = Page(files["documentation/index.html"].decode())
    assert page.open == []
    assert about.rows <= set(page.words)
    assert {v.text for v in about.variables} <= set(page.words)
    assert [src for src in page.pictures if f"documentation/{src}" not in files] == []


def test_the_documentation_shows_the_equations_of_the_model(archive, files, sources):
    opening = re.match(r"/\*(.*?)\*/", sources[f"{archive.stem}.c"], re.DOTALL)[1]
    lines = [line.removeprefix(" *") for line in opening.splitlines()]
    page = Page(files["documentation/index.html"].decode())
    prose, equations = " ".join(" ".join(page.words).split()), page.equations
    assert [e for e in lines if e.startswith("   ") and " ".join(e.split()) not in equations] == []
    rest = [" ".join(line.split()) for line in lines if not line.startswith("   ")]
    assert [line for line in rest if line not in prose] == []


def test_the_licence_matches_the_project(files):
    assert files["licenses/license.txt"] == (ROOT / "LICENSE").read_bytes()


def test_pictures_are_pictures(files):
    pictures = {name: data for name, data in files.items() if name.endswith(".png")}
    assert "model.png" in pictures
    for data in pictures.values():
        width, height = png.size(data)
        assert 100 <= width <= 4000
        assert 50 <= height <= 4000


def test_a_damaged_picture_would_be_noticed(files):
    data = files["model.png"]
    for damaged in (
        b"",
        data[1:],
        data[:-1],
        data[:40] + b"\0" + data[41:],
        data.replace(b"IDAT", b"IDAX"),
    ):
        with pytest.raises((ValueError, IndexError)):
            png.size(damaged)
