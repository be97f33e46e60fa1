# SPDX-License-Identifier: BSD-2-Clause
"""What is kept between runs: private, whole, the right content, small enough, and never needed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from harness import run
from harness.errors import ArchiveError
from harness.files import cache
from harness.master.simulation import Simulation
from tests.harness import foreign_fmu
from tests.harness.foreign_fmu import Model, build, p, y

pytestmark = pytest.mark.skipif(os.name != "posix", reason="nothing is kept on Windows")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("HARNESS_CACHE", str(folder))
    return folder


def archive(path, **content):
    with zipfile.ZipFile(path, "w") as file:
        for name, text in content.items():
            file.writestr(name, text)
    return path


def entries(place):
    return sorted(f.name for f in place.iterdir() if f.is_dir() and f.name != "passed")


def test_the_same_content_is_unpacked_once_and_other_content_elsewhere(place, tmp_path):
    one, two = archive(tmp_path / "one.zip", a="x"), archive(tmp_path / "two.zip", a="y")
    with cache.unpacked(one) as first, cache.unpacked(one) as again, cache.unpacked(two) as other:
        assert first == again != other
        assert [(f / "a").read_text() for f in (first, again, other)] == ["x", "x", "y"]
    archive(one, a="y")
    with cache.unpacked(one) as first:
        assert (first / "a").read_text() == "y"
    assert len(entries(place)) == 2


def test_the_folder_is_private(place, tmp_path):
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")):
        assert place.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o707])
def test_a_folder_that_others_may_enter_is_not_used(place, tmp_path, caplog, mode):
    place.mkdir()
    place.chmod(mode)
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert list(place.iterdir()) == []
    assert "others may enter it" in caplog.text


def test_a_folder_that_others_could_exchange_is_not_used(tmp_path, monkeypatch, caplog):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "open" / "cache"))
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert f"others may write to {tmp_path / 'open'}" in caplog.text


def test_a_link_to_a_folder_is_not_used(place, tmp_path, caplog):
    (tmp_path / "real").mkdir(mode=0o700)
    place.symlink_to(tmp_path / "real")
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert "it is not a folder" in caplog.text


@pytest.mark.parametrize("value", ["", "off", "0"])
def test_nothing_is_kept_if_that_is_wanted(tmp_path, monkeypatch, value):
    monkeypatch.setenv("HARNESS_CACHE", value)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert not (tmp_path / "home").exists()


def test_a_damaged_archive_leaves_nothing(place, tmp_path):
    (tmp_path / "bad.zip").write_bytes(b"PK\x03\x04 not really")
    with cache.unpacked(tmp_path / "bad.zip") as found:
        assert found is None
    assert entries(place) == []
    with pytest.raises(ArchiveError, match="damaged"):
        run(tmp_path / "bad.zip")


def test_what_was_used_least_recently_goes_first_and_nothing_in_use(place, tmp_path, monkeypatch):
    files = [archive(tmp_path / f"{k}.zip", a=str(k) * 1000) for k in range(4)]
    monkeypatch.setattr(cache, "LIMIT", 2500)
    folders = []
    for file in files[:2]:
        with cache.unpacked(file) as found:
            folders.append(found)
        time.sleep(0.02)
    with cache.unpacked(files[0]) as oldest:  # 1 is the one used least recently now
        time.sleep(0.02)
        with cache.unpacked(files[2]):
            assert oldest.is_dir()
            assert not folders[1].exists()
    monkeypatch.setattr(cache, "LIMIT", 0)
    with cache.unpacked(files[2]) as used, cache.unpacked(files[3]) as new:
        assert (used / "a").read_text() == "2" * 1000
        assert (new / "a").read_text() == "3" * 1000
    assert len(entries(place)) == 2


def test_a_half_unpacked_folder_of_a_process_that_was_killed_is_not_used_and_goes(place, tmp_path):
    with cache.unpacked(archive(tmp_path / "a.zip", a="x")):
        pass
    left = place / "new-abc"
    left.mkdir()
    os.utime(left, (0, 0))
    with cache.unpacked(archive(tmp_path / "b.zip", a="y")) as found:
        assert (found / "a").read_text() == "y"
    assert not left.exists()


MANY = """
import sys
from pathlib import Path
from harness.files import cache
cache.LIMIT = 0
for k in range(150):
    with cache.unpacked(Path(sys.argv[1 + k % 2])) as found:
        assert (found / "a").read_text() == sys.argv[3 + k % 2], k
"""


def test_processes_that_add_use_and_remove_at_once_do_not_disturb_each_other(place, tmp_path):
    files = [archive(tmp_path / f"{k}.zip", a=str(k)) for k in range(2)]
    command = [sys.executable, "-c", MANY, *map(str, files), "0", "1"]
    with ThreadPoolExecutor(3) as pool:
        done = [pool.submit(subprocess.run, command, capture_output=True) for _ in range(3)]
        assert [job.result().stderr for job in done] == [b""] * 3


def test_a_check_is_repeated_only_for_other_content(place):
    seen = []
    for content in (b"a", b"b", b"a", b"a"):
        cache.passed("kind", content, lambda content=content: seen.append(content))
    cache.passed("other kind", b"a", lambda: seen.append(b"other"))
    assert seen == [b"a", b"b", b"other"]


def test_a_check_that_failed_is_repeated(place):
    def fail():
        raise ValueError("wrong")

    for _ in range(2):
        with pytest.raises(ValueError, match="wrong"):
            cache.passed("kind", b"a", fail)


# ---- FMUs


GLOBAL = Model(
    "sharing",
    [y("n"), p("k")],
    "n = total;",
    "total += 1;",
)
"""Counts the steps of all its instances in one global: of two copies each counts its own."""


def test_components_of_one_foreign_fmu_do_not_share_its_globals(make, place, tmp_path, monkeypatch):
    source = f"static int total;\n{foreign_fmu.SOURCE_TEXT}"
    monkeypatch.setattr(foreign_fmu, "SOURCE_TEXT", source)
    path = build(GLOBAL, tmp_path)
    system = make({"a": "counter", "b": "counter"})
    system = replace(system, components=tuple(replace(c, fmu=path) for c in system.components))
    for _ in range(2):  # the second time from the cache
        result = run(system)
        assert result["a.n"].tolist() == result["b.n"].tolist() == [0, 1, 2, 3, 4, 5, 6]
    with Simulation(system) as simulation:
        for _ in range(3):
            assert simulation.fly()["a.n"].tolist() == [0, 1, 2, 3, 4, 5, 6]


def test_the_bits_are_those_of_a_run_without_cache(place, monkeypatch):
    kept = [run("sync_approach", stop=2.0) for _ in range(2)]
    monkeypatch.setenv("HARNESS_CACHE", "off")
    fresh = run("sync_approach", stop=2.0)
    assert {r.values.tobytes() for r in kept} == {fresh.values.tobytes()}
    assert {r.parameters.values.tobytes() for r in kept} == {fresh.parameters.values.tobytes()}
