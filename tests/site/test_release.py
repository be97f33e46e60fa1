# SPDX-License-Identifier: BSD-2-Clause
"""A release: one version, artefacts with checksums and a page, sources that are complete."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import harness
from harness.files import paths
from harness.master.simulation import Simulation
from harness.system.interface import read_interface
from tests.site.scripts import script

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def release():
    return script("release")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, release):
    """A folder of two FMUs and a system with what the script writes."""
    place = tmp_path_factory.mktemp("dist")
    (place / "fmus").mkdir()
    for name in ("target", "servicer"):
        shutil.copy(paths.fmus()[name], place / "fmus")
    shutil.copy(paths.systems()["sync_approach"], place)
    release.write(place)
    return place


def test_the_version_is_in_one_place_and_the_citation_agrees(release):
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, re.M)[1] == release.version()
    assert harness.__version__ == release.version()
    for name in ("CMakeLists.txt", "fmus/CMakeLists.txt"):
        assert release.version() not in (ROOT / name).read_text(encoding="utf-8")


def test_the_fmus_carry_version_and_date_of_the_release(release):
    from fmpy import read_model_description

    found = read_model_description(str(paths.fmus()["target"]))
    assert found.version == release.version()
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    day = re.search(r"^date-released: (.*)$", citation, re.M)[1]
    assert found.generationDateAndTime == f"{day}T00:00:00Z"


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_checksums_match_sha256sum(folder):
    assert len((folder / "SHA256SUMS").read_text().splitlines()) == 3
    subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=folder, check=True)


def test_the_page_lists_every_artefact_with_its_checksum(folder, release):
    page = (folder / "index.html").read_text(encoding="utf-8")
    for path in release.artefacts(folder):
        assert f"href='{path.relative_to(folder).as_posix()}'" in page
        assert release.digest(path) in page
    assert "Tumbling non-cooperative target" in page
    assert "FMI 2.0: linux64" in page
    assert "SSP 1.0: 6 FMUs" in page


def test_every_system_has_a_twin_of_ssp_2_and_fmi_3(tmp_path):
    from harness.ssp.reader import opened

    twins = script("reference_systems")
    shutil.copytree(paths.fmus()["target"].parents[1] / "fmus3", tmp_path / "fmus3")
    (tmp_path / "ssp").mkdir()
    shutil.copy(paths.systems()["sync_approach"], tmp_path / "ssp")
    (twin,) = twins.write(tmp_path)
    assert twins.write(tmp_path) == [twin]
    assert twin.name == "sync_approach.fmi3.ssp"
    with opened(twin) as new, opened(paths.systems()["sync_approach"]) as old:
        assert new.connections == old.connections
        assert all(read_interface(c.fmu).fmi == 3 for c in new.components)
        bits = [_rows(system) for system in (new, old)]
    assert bits[0] == bits[1]


def _rows(system):
    with Simulation(system, stop=5.0) as simulation:
        simulation.advance()
        return simulation.recorder.rows.tobytes()


COMPILER = """import sys
name, sources = sys.argv[sys.argv.index("-o") + 1], [a for a in sys.argv if a.endswith(".c")]
open(name, "w").write(128 * "0" + sys.argv[2] + " " + " ".join(sources))
"""
"""A compiler whose libraries say what they are made of."""


def test_one_library_of_a_platform_serves_both_versions_of_fmi(tmp_path):
    (tmp_path / "cc.py").write_text(COMPILER, encoding="utf-8")
    for folder in ("fmus", "fmus3"):
        (tmp_path / folder).mkdir()
        shutil.copy(paths.fmus()["target"].parents[1] / folder / "target.fmu", tmp_path / folder)
    script, folders = ROOT / "fmus/core/build/cross_compile.py", ["fmus", "fmus3"]
    compiler = [sys.executable, str(tmp_path / "cc.py")]
    subprocess.run(
        [sys.executable, script, "--fmus", *folders, "-o", "dist", "--cc", *compiler],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    made = {folder: _contents(tmp_path / "dist" / folder / "target.fmu") for folder in folders}
    for two, three in PLATFORMS.items():
        library = made["fmus"][two]
        assert made["fmus3"][three] == library
        assert {"target.c", "fmi2.c", "fmi3.c", "state.c"} <= set(library.decode().split())
    for folder in folders:
        old = _contents(tmp_path / folder / "target.fmu")
        new = {name: data for name, data in made[folder].items() if "binaries" not in name}
        assert new == {name: data for name, data in old.items() if "binaries" not in name}
        assert len(made[folder]) == len(new) + len(PLATFORMS)


PLATFORMS = {
    "binaries/linux64/target.so": "binaries/x86_64-linux/target.so",
    "binaries/win64/target.dll": "binaries/x86_64-windows/target.dll",
    "binaries/darwin64/target.dylib": "binaries/x86_64-darwin/target.dylib",
    "binaries/aarch64-darwin/target.dylib": "binaries/aarch64-darwin/target.dylib",
}
"""The same library in an archive of FMI 2.0 and in one of FMI 3.0."""


def _contents(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture
def complete(release, tmp_path, monkeypatch):
    """A folder with small files of all names that a release has, and a clean repository."""
    for name, pattern in release.expected().items():
        path = tmp_path / pattern.replace("*", "py3-none-any")
        path.parent.mkdir(exist_ok=True)
        with zipfile.ZipFile(path, "w") as archive:
            if path.suffix == ".fmu":
                text = f"<d fmiVersion='3.0' version='{release.version()}'/>"
                archive.writestr("modelDescription.xml", text)
                for platform in PLATFORMS.values():
                    archive.writestr(platform, "")
            elif path.suffix == ".ssp":
                archive.writestr("SystemStructure.ssd", "<d version='1.0'/>")
            else:
                archive.writestr("harness/data/site/index.html", name)
    monkeypatch.setattr(release, "_git", lambda *words: "")
    release.write(tmp_path)
    return tmp_path


def test_a_complete_release_prints_the_two_commands_that_publish_it(release, complete, capsys):
    assert release.check(complete) == 0
    commands = [line for line in capsys.readouterr().out.splitlines() if line.startswith("    ")]
    tag = f"v{release.version()}"
    assert commands == [
        f"    git tag -a {tag} -m 'servicing-fmus {release.version()}'",
        f"    git push origin {tag}",
    ]


def _repack(path, name, data):
    """Write an archive again with other data of one of its files, or without it."""
    with zipfile.ZipFile(path) as archive:
        contents = {n: archive.read(n) for n in archive.namelist()} | {name: data}
    with zipfile.ZipFile(path, "w") as archive:
        for each, content in contents.items():
            if content is not None:
                archive.writestr(each, content)


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (lambda d: (d / "fmus3/target.fmu").unlink(), "fmus3/target.fmu: missing"),
        (lambda d: (d / "traceability.zip").unlink(), "traceability.zip: missing"),
        (lambda d: (d / "ssp/sync_approach.fmi3.ssp").unlink(), "approach.fmi3.ssp: missing"),
        (
            lambda d: shutil.copy(next(d.glob("*.whl")), d / "servicing_fmus-0.1.0-x.whl"),
            "2 files match, expected one",
        ),
        (
            lambda d: _repack(
                d / "fmus/target.fmu", "modelDescription.xml", "<d version='0.0.9'/>"
            ),
            "target.fmu: version 0.0.9, expected",
        ),
        (
            lambda d: _repack(d / "fmus/gyro.fmu", "binaries/aarch64-darwin/target.dylib", None),
            "gyro.fmu: binaries for 3 platforms, expected 4",
        ),
        (
            lambda d: _repack(next(d.glob("*.whl")), "harness/data/site/index.html", None),
            "contains no documentation site",
        ),
    ],
)
def test_missing_parts_of_a_release_are_reported(release, complete, spoil, line, capsys):
    spoil(complete)
    release.write(complete)
    assert release.check(complete) == 1
    assert line in capsys.readouterr().err


def test_checksums_that_differ_from_the_files_are_reported(release, complete):
    (complete / "traceability.zip").write_bytes(b"other")
    (line,) = release.problems(complete)
    assert line.endswith("SHA256SUMS: differs from the files; write it with .ci/release.py")


def test_a_release_of_an_unclean_or_older_tree_is_reported(release, complete, monkeypatch):
    answers = {"status": " M README.md", "--list": f"v{release.version()}", "--points-at": ""}
    monkeypatch.setattr(
        release, "_git", lambda *words: next(answers[w] for w in words if w in answers)
    )
    first, second = release.problems(complete)
    assert "not committed" in first
    assert "belongs to another commit" in second


def test_the_changelog_describes_the_version_and_its_date(release, tmp_path, monkeypatch):
    assert list(release._versions()) == []
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    for name in ("harness/__init__.py", "CITATION.cff"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "CHANGELOG.md").write_text(text.replace("## [0.1.0] - ", "## [0.0.9] - "))
    monkeypatch.setattr(release, "ROOT", tmp_path)
    assert [line.partition(":")[0] for line in release._versions()] == ["CHANGELOG.md"]


def test_workflows_request_few_permissions_and_pin_their_actions():
    import yaml

    for path in sorted((ROOT / ".github/workflows").glob("*.yml")):
        text = path.read_text(encoding="utf-8")
        flow = yaml.safe_load(text)
        assert flow["permissions"] == {"contents": "read"}, path.name
        assert "concurrency" in flow, path.name
        for action in re.findall(r"uses: (\S+)", text):
            assert re.fullmatch(r"[\w-]+/[\w/.-]+@([0-9a-f]{40}|v\d+(\.\d+)*|release/v\d+)", action)
        for command in re.findall(r"make ([a-z-]+)", text):
            assert re.search(rf"^{command}:", (ROOT / "Makefile").read_text(), re.M), command


def test_extras_that_the_workflows_install_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for path in (ROOT / ".github/workflows").glob("*.yml"):
        for names in re.findall(r"whl\)?\[([\w,]+)\]", path.read_text(encoding="utf-8")):
            assert set(names.split(",")) <= set(extras)
