# SPDX-License-Identifier: BSD-2-Clause
"""Files from anywhere: entities, bombs, and what is left on the disk when a run ends badly."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import zipfile

import pytest

from harness import run
from harness.errors import ArchiveError, FmuError, HarnessError
from harness.files.archive import read_entry, unpack
from harness.files.output import PrivateFolder
from harness.system.interface import read_interface
from tests.harness import interrupts
from tests.harness.interrupts import until
from tests.harness.third_party_fmu import COUNTER, description
from tests.harness.third_party_ssp import component, ssm, ssv, system, write

LAUGHS = '<!DOCTYPE x [<!ENTITY a0 "ha">' + "".join(
    f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12)
) + "]>"  # fmt: skip


@pytest.mark.parametrize("kind", ["laughs", "external", "utf-16"])
@pytest.mark.parametrize(
    "place", ["SystemStructure.ssd", "set.ssv", "map.ssm", "modelDescription.xml"]
)
def test_no_entity_is_read_in_any_file(fmus, tmp_path, place, kind):
    (tmp_path / "secret").write_text("secret")
    doctype = (
        f'<!DOCTYPE x [<!ENTITY a11 SYSTEM "file://{tmp_path}/secret">]>'
        if kind == "external"
        else LAUGHS
    )
    with pytest.raises(HarnessError) as caught:
        run(poisoned(fmus, tmp_path, place, doctype, "utf-16" if kind == "utf-16" else "utf-8"))
    assert "document type declaration" in str(caught.value)


def poisoned(fmus, folder, place, doctype, encoding):
    """A system with a document type and a use of its entity in one of its files."""
    mapping = '<d:ParameterMapping source="map.ssm"/>'
    binding = f'<d:ParameterBinding source="set.ssv">{mapping}</d:ParameterBinding>'
    files = {"set.ssv": ssv("k=1", namespaces=True), "map.ssm": ssm("k n_0", namespaces=True)}

    def poison(text):
        body = text.split("?>\n", 1)[-1].replace(">", ">&a11;", 1)
        return f'<?xml version="1.0" encoding="{encoding}"?>{doctype}{body}'.encode(encoding)

    if place in files:
        files[place] = poison(files[place])
    fmu = fmus["counter"]
    if place == "modelDescription.xml":
        fmu = folder / "counter.fmu"
        with zipfile.ZipFile(fmu, "w") as archive:
            archive.writestr(place, poison(description(COUNTER)))
    top = system("top", [component("counter", "counter", bindings=binding)], [])
    path = write(folder / "x.ssp", top, {"counter": fmu}, files)
    if place == "SystemStructure.ssd":
        with zipfile.ZipFile(path) as archive:
            content = {name: archive.read(name) for name in archive.namelist()}
        content[place] = poison(content[place].decode())
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in content.items():
                archive.writestr(name, data)
    return path


def test_an_fmu_inside_a_system_is_checked_like_the_system(fmus, tmp_path):
    evil = tmp_path / "counter.fmu"
    with zipfile.ZipFile(fmus["counter"]) as good, zipfile.ZipFile(evil, "w") as archive:
        for name in good.namelist():
            archive.writestr(name, good.read(name))
        archive.writestr("../../outside", "evil")
    path = write(
        tmp_path / "x.ssp", system("top", [component("c", "counter")], []), {"counter": evil}
    )
    with pytest.raises(FmuError, match="a path that leaves the archive"):
        run(path)
    assert not (tmp_path.parent / "outside").exists()


def test_a_description_too_long_to_read_is_rejected_before_it_is_read(tmp_path):
    path = tmp_path / "bomb.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", bytes(65 * 1024**2))
    with pytest.raises(FmuError, match="longer than the limit of 67108864 bytes"):
        read_interface(path)


def test_a_size_that_lies_is_damage(tmp_path):
    path = tmp_path / "lie.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a", bytes(100_000))
    data = path.read_bytes().replace((100_000).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    path.write_bytes(data)
    (tmp_path / "into").mkdir()
    with pytest.raises(ArchiveError, match="damaged"):
        unpack(path, tmp_path / "into")
    assert sum(p.stat().st_size for p in (tmp_path / "into").iterdir()) <= 10
    with pytest.raises(ArchiveError, match="damaged"):
        read_entry(path, "a")


def test_too_many_files_are_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.files.archive.MAX_FILES", 3)
    path = tmp_path / "many.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for i in range(4):
            archive.writestr(str(i), "")
    (tmp_path / "into").mkdir()
    with pytest.raises(ArchiveError, match="it holds 4 files, more than the limit of 3"):
        unpack(path, tmp_path / "into")
    assert list((tmp_path / "into").iterdir()) == []


# ---- what is left behind


@pytest.fixture
def process(fmus, tmp_path):
    """Start a run of one FMU with temporary files in a folder of its own; gives process and
    folder.
    """
    scratch = tmp_path / "scratch"
    scratch.mkdir()

    def start(fmu):
        path = write(tmp_path / "x.ssp", system("top", [component("a", fmu)], []), fmus)
        command = [
            sys.executable,
            "-m",
            "harness",
            "run",
            str(path),
            "-o",
            "x.csv",
            "--stop",
            "100000",
        ]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
            "TMPDIR": str(scratch),
        }
        quiet = subprocess.DEVNULL
        return interrupts.start(
            command, env=environment, cwd=tmp_path, stdout=quiet, stderr=quiet
        ), scratch

    return start


def test_nothing_is_left_after_a_crash_inside_an_fmu(process):
    running, scratch = process("crashing")
    assert running.wait(timeout=interrupts.LONGEST) == 1
    until(lambda: not any(scratch.iterdir()), "empty folder")


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_nothing_is_left_after_the_run_was_ended_from_outside(process, tmp_path, end):
    running, scratch = process("slow")
    until((tmp_path / "stepping").exists, "step")
    assert list(scratch.iterdir())
    running.send_signal(end)
    running.wait(timeout=interrupts.LONGEST)
    until(lambda: not any(scratch.iterdir()), "empty folder")


def test_a_private_folder_is_private_and_is_removed_with_its_block():
    with PrivateFolder() as folder:
        assert folder.stat().st_mode & 0o077 == 0
        (folder / "x").write_text("x")
    assert not folder.exists()
