# SPDX-License-Identifier: BSD-2-Clause
"""Files stored between runs: private, whole, the right content, small enough, and never needed."""

from __future__ import annotations

import errno
import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import pytest

from harness import run
from harness.cli import main
from harness.errors import ArchiveError, FmuError, ResultsError
from harness.files import cache
from harness.files.archive import pack, read_entry
from harness.files.checksums import UNFINISHED
from harness.master.simulation import Simulation
from harness.ssp import reader
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.studies.reuse import ReusedSimulation
from tests.each import some
from tests.harness import third_party_fmu
from tests.harness.third_party_fmu import Model, build, p, y

pytestmark = pytest.mark.skipif(os.name != "posix", reason="nothing is cached on Windows")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("HARNESS_CACHE", str(folder))
    monkeypatch.setattr(cache, "TIDY_SECONDS", 0.0)
    return folder


def archive(path, **content):
    with zipfile.ZipFile(path, "w") as file:
        for name, text in content.items():
            file.writestr(zipfile.ZipInfo(name), text)  # the same bytes at any time
    return path


@contextmanager
def unpacked(path):
    """The folder, and afterwards the process uses nothing of the cache any more."""
    yield cache.unpacked(path)
    if (root := cache.folder()) is not None:
        os.close(cache._hold(root))
        cache._hold.cache_clear()


def entries(place):
    return sorted(f.name for f in place.iterdir() if f.is_dir())


def test_the_same_content_is_unpacked_once_and_other_content_elsewhere(place, tmp_path):
    one, two = archive(tmp_path / "one.zip", a="x"), archive(tmp_path / "two.zip", a="y")
    with unpacked(one) as first, unpacked(one) as again, unpacked(two) as other:
        assert first == again != other
        assert [(f / "a").read_text() for f in (first, again, other)] == ["x", "x", "y"]
    archive(one, a="y")
    with unpacked(one) as first:
        assert (first / "a").read_text() == "y"
    assert len(entries(place)) == 2


def test_a_process_reads_a_system_once_and_states_its_notes_every_time(
    place, make, tmp_path, monkeypatch, caplog
):
    path, reads, reported, read = tmp_path / "a.ssp", [], [], reader._of_folder

    @lru_cache
    def counted(folder):
        reads.append(folder)
        return read(folder)._replace(notes=tuple(reported))

    def steps(*loads):
        found = []
        for stop in loads:
            if stop is not None:
                write_ssp(make({"a": "counter"}, stop=stop), path)
            with load(path) as system:
                found.append(system.experiment.stop)
        return found

    monkeypatch.setattr(reader, "_known", counted)
    assert steps(6.0, None, None) == [6.0] * 3
    assert len(reads) == 1
    assert steps(7.0, None, 6.0) == [7.0, 7.0, 6.0]
    assert len(reads) == 2
    reported.append("an odd file")
    assert steps(8.0, None) == [8.0, 8.0]
    assert len(reads) == 3
    assert caplog.messages == reported * 2


def test_the_folder_is_private(place, tmp_path):
    with unpacked(archive(tmp_path / "a.zip", a="x")):
        assert place.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o707])
def test_a_folder_that_others_may_enter_is_not_used(place, tmp_path, caplog, mode):
    place.mkdir()
    place.chmod(mode)
    with unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert list(place.iterdir()) == []
    assert "others may enter it" in caplog.text


def test_a_folder_that_others_could_exchange_is_not_used(tmp_path, monkeypatch, caplog):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "open" / "cache"))
    with unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert f"others may write to {tmp_path / 'open'}" in caplog.text


def test_a_link_to_a_folder_is_not_used(place, tmp_path, caplog):
    (tmp_path / "real").mkdir(mode=0o700)
    place.symlink_to(tmp_path / "real")
    with unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert "it is not a folder" in caplog.text


@pytest.mark.parametrize("value", ["", "off", "0"])
def test_nothing_is_retained_if_that_is_required(tmp_path, monkeypatch, value):
    monkeypatch.setenv("HARNESS_CACHE", value)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with unpacked(archive(tmp_path / "a.zip", a="x")) as found:
        assert found is None
    assert not (tmp_path / "home").exists()


def test_a_damaged_archive_leaves_nothing(place, tmp_path):
    (tmp_path / "bad.zip").write_bytes(b"PK\x03\x04 not really")
    with unpacked(tmp_path / "bad.zip") as found:
        assert found is None
    assert entries(place) == []
    with pytest.raises(ArchiveError, match="damaged"):
        run(tmp_path / "bad.zip")


def test_the_least_recently_used_is_removed_first_and_nothing_in_use(place, tmp_path, monkeypatch):
    files = [archive(tmp_path / f"{k}.zip", a=str(k) * 1000) for k in range(4)]
    folders = [cache.unpacked(file) for file in files[:3]]
    os.close(cache._hold(place))
    for k, folder in enumerate((folders[1], folders[0], folders[2])):
        os.utime(folder.parent, (k, k))
    monkeypatch.setattr(cache, "LIMIT", 2500)  # two entries of 1000 and their hashes
    cache._hold.cache_clear()
    with unpacked(files[3]) as new:
        assert [folder.is_dir() for folder in folders] == [True, False, True]
        other = [sys.executable, "-c", MANY, str(files[0]), str(files[0]), "0" * 1000, "0" * 1000]
        assert subprocess.run(other, capture_output=True, check=False).stderr == b""
        assert (new / "a").read_text() == "3" * 1000  # nobody else is alone


def test_the_size_is_looked_at_once_an_hour(place, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "TIDY_SECONDS", 3600.0)
    monkeypatch.setattr(cache, "LIMIT", 0)
    folder = cache.unpacked(archive(tmp_path / "a.zip", a="x"))
    for age, there in ((3500, True), (3700, False), (0, False)):
        os.close(cache._hold(place))
        cache._hold.cache_clear()
        begun = time.time() - age
        os.utime(place / "used", (begun, begun))
        cache._hold(place)
        assert folder.is_dir() is there
        assert (time.time() - (place / "used").stat().st_mtime < 60) is (age != 3500)


def test_a_half_unpacked_folder_of_a_killed_process_is_not_used_and_is_removed(place, tmp_path):
    with unpacked(archive(tmp_path / "a.zip", a="x")):
        pass
    left = place / "new-abc"
    left.mkdir()
    os.utime(left, (0, 0))
    with unpacked(archive(tmp_path / "b.zip", a="y")) as found:
        assert (found / "a").read_text() == "y"
    assert not left.exists()


MANY = """
import os, sys
from pathlib import Path
from harness.files import cache
cache.LIMIT, cache.TIDY_SECONDS = 0, 0.0
for k in range(150):
    found = cache.unpacked(Path(sys.argv[1 + k % 2]))
    assert (found / "a").read_text() == sys.argv[3 + k % 2], k
    os.close(cache._hold(found.parents[1]))
    cache._hold.cache_clear()
"""


def test_processes_that_add_use_and_remove_at_once_do_not_disturb_each_other(place, tmp_path):
    files = [archive(tmp_path / f"{k}.zip", a=str(k)) for k in range(2)]
    command = [sys.executable, "-c", MANY, *map(str, files), "0", "1"]
    with ThreadPoolExecutor(6) as pool:
        done = [pool.submit(subprocess.run, command, capture_output=True) for _ in range(6)]
        assert [job.result().stderr for job in done] == [b""] * 6


# ---- damage

LIBRARY = "binaries/linux64/x.so"
CONTENT = {LIBRARY: bytes(range(256)) * 80, "modelDescription.xml": b"<a/>", "resources/r": b"r"}


def fill(path):
    with zipfile.ZipFile(path, "w") as file:
        for name, data in CONTENT.items():
            file.writestr(name, data)
    return path


def read(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def rewrite(change):
    """Damage of a file: change(bytes) gives its new content."""
    return lambda path: path.write_bytes(change(path.read_bytes()))


DAMAGE = {
    "cut at 5000 bytes": rewrite(lambda data: data[:5000]),
    "zeros": rewrite(lambda data: bytes(len(data))),
    "empty": rewrite(lambda data: b""),
    "one bit": rewrite(lambda data: data[:-1] + bytes([data[-1] ^ 1])),
    "longer": rewrite(lambda data: data + b"x"),
    "missing": Path.unlink,
    "another name": lambda path: path.rename(path.with_name("other")),
    "a folder": lambda path: (path.unlink(), path.mkdir()),
}


@pytest.mark.parametrize("name", [LIBRARY, "modelDescription.xml"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_entry_is_made_anew(place, tmp_path, name, damage):
    path = fill(tmp_path / "x.fmu")
    with unpacked(path) as found:
        DAMAGE[damage](found / name)
    for _ in range(2):
        with unpacked(path) as found:
            assert read(found) == CONTENT
    assert len(entries(place)) == 1


@pytest.mark.parametrize("left", [[], ["sha256"], ["content"]])
def test_an_entry_of_which_something_is_left_is_made_anew(place, tmp_path, left):
    path = fill(tmp_path / "x.fmu")
    with unpacked(path) as found:
        pass
    for part in {"sha256", "content"} - set(left):
        (found.parent / part).rename(tmp_path / part)
    with unpacked(path) as found:
        assert read(found) == CONTENT


def test_a_damaged_file_that_was_made_is_made_anew(place):
    made, firmware = [], bytes(range(256)) * 40

    def make(path):
        made.append(path)
        path.write_bytes(firmware)

    for damage in DAMAGE.values():
        damage(cache.made("firmware.elf", b"key", make))
        assert cache.made("firmware.elf", b"key", make).read_bytes() == firmware
    assert len(made) == 1 + len(DAMAGE)


def test_an_entry_is_locked_once_in_a_process(place):
    def descriptors():
        return len(list(Path("/proc/self/fd").iterdir()))

    cache.made("x", b"key of this test", Path.touch)
    before = descriptors()
    for _ in range(5):
        cache.made("x", b"key of this test", Path.touch)
    assert descriptors() == before


def test_an_entry_is_on_the_disk_before_it_has_its_name(place, tmp_path, monkeypatch):
    """In the order of the calls: every file and folder inside, then the name, then its folder."""
    events = []
    sync, rename = os.fsync, Path.rename

    def synced(descriptor):
        events.append(("sync", Path(f"/proc/self/fd/{descriptor}").readlink()))
        sync(descriptor)

    def renamed(self, target):
        moved = rename(self, target)
        events.append(("rename", self))
        return moved

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "rename", renamed)
    with unpacked(fill(tmp_path / "x.fmu")) as found:
        pass
    (at,) = [k for k, (what, _) in enumerate(events) if what == "rename"]
    entry, new = found.parent, events[at][1]
    inside = {new / path.relative_to(entry) for path in entry.rglob("*")}
    assert {path for _, path in events[:at]} == inside | {new}
    assert events[at + 1 :] == [("sync", place)]


RUN = "from harness import run; print(len(run('sync_approach', stop=1.0).time))"


@pytest.mark.parametrize("damage", some(["cut at 5000 bytes", "zeros"], 2))
def test_a_run_with_damaged_libraries_in_the_cache_is_a_run(place, damage):
    """In a process of its own: a library that is too short ends it with SIGBUS."""

    def output():
        done = subprocess.run([sys.executable, "-c", RUN], capture_output=True, check=False)
        return done.returncode, done.stdout, done.stderr

    required = output()
    libraries = list(place.glob("*/content/binaries/*/*"))
    assert len(libraries) >= 5
    for library in libraries:
        DAMAGE[damage](library)
    assert output() == required == (0, b"11\n", b"")


@pytest.fixture
def cut(place, monkeypatch):
    """Cut files in every entry that is used, right after it was checked; in new files, because
    programs may have loaded the old ones.
    """

    def prepare(pattern, content=None):
        def handed_out(entry, make, retained=cache._entry):
            folder = retained(entry, make)
            for file in folder.rglob(pattern):
                new = file.with_name("new")
                new.write_bytes(file.read_bytes()[:100] if content is None else content)
                new.replace(file)
            return folder

        monkeypatch.setattr(cache, "_entry", handed_out)

    monkeypatch.setattr(cache, "_left_out", set())
    return prepare


CUT = {"*.so": "c", "*.fmu": "c", "*.ssd": "c", "whole.fmu": "fused"}
"""Files, and the executor of a run that reads them."""


@pytest.mark.parametrize("pattern", CUT)
def test_a_file_that_is_cut_while_it_is_read_costs_a_line_and_no_run(cut, caplog, pattern, place):
    required = run("space_robot", stop=2.0)
    cut(pattern)
    reader._known.cache_clear()  # of the first run
    for system in place.glob("*/content/system"):
        shutil.rmtree(system.parents[1])
    found = run("space_robot", stop=2.0, executor=CUT[pattern])
    assert found.values.tobytes() == required.values.tobytes()
    assert caplog.text.count("a file in it was damaged while it was read") == 1


def test_a_command_and_a_run_of_a_campaign_survive_a_cut_too(cut, caplog, tmp_path):
    cut("*.so")
    with closing(ReusedSimulation("sync_approach")) as reused:
        assert reused.run({"stop": 1.0}).complete
    cache._left_out.clear()
    assert main(["run", "sync_approach", "--stop", "1", "-o", str(tmp_path / "x.csv")]) == 0
    assert caplog.text.count("a file in it was damaged while it was read") == 2


def test_a_damage_that_another_process_has_mended_meanwhile_costs_no_run(place, tmp_path):
    archive, attempts = fill(tmp_path / "x.zip"), []
    mend = (
        "import pathlib, sys\n"
        "from harness.files.cache import unpacked\n"
        "unpacked(pathlib.Path(sys.argv[1]))"
    )

    def work():
        attempts.append(cache.unpacked(archive))
        if len(attempts) == 1:
            next(path for path in attempts[0].rglob("*") if path.is_file()).write_bytes(b"")
            subprocess.run([sys.executable, "-c", mend, str(archive)], check=True)
            raise FmuError("cannot be loaded")

    cache.with_second_try(work)
    assert [attempt is None for attempt in attempts] == [False, True]


def test_an_error_that_is_no_damage_is_reported_at_once(place, tmp_path):
    attempts = []

    def work():
        attempts.append(cache.unpacked(fill(tmp_path / "x.zip")))
        (place / f"{UNFINISHED}entry").mkdir()  # another process is writing it
        raise FmuError("cannot be loaded")

    with pytest.raises(FmuError, match="cannot be loaded"):
        cache.with_second_try(work)
    assert len(attempts) == 1
    assert cache.folder() == place


# ---- values


@pytest.mark.parametrize("damage", [b"", b"\x80\x05X", b"no pickle"])
def test_a_value_is_computed_once_and_anew_when_its_file_is_damaged(cut, place, damage):
    computed = []

    def compute():
        computed.append(len(computed))
        return {"value": 0.1}

    assert [cache.computed("x", b"key", compute) for _ in range(3)] == [{"value": 0.1}] * 3
    assert len(computed) == 1
    cache.computed("x", b"other", compute)
    cache.computed("y", b"key", compute)
    assert len(computed) == 3
    cut("x", damage)
    assert cache.computed("x", b"key", compute) == {"value": 0.1}
    assert len(computed) == 4


def test_a_value_is_computed_anew_by_other_code_and_without_a_cache(place, monkeypatch):
    computed = []
    for code in (b"1", b"1", b"2"):
        monkeypatch.setattr(cache, "_code", lambda code=code: code)
        cache.computed("x", b"key", lambda: computed.append(0))
    assert len(computed) == 2
    monkeypatch.setenv("HARNESS_CACHE", "off")
    for _ in range(2):
        cache.computed("x", b"key", lambda: computed.append(0))
    assert len(computed) == 4


# ---- a cache that cannot be used


def notes(caplog):
    return [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]


def used_three_times(path):
    for _ in range(3):
        with unpacked(path) as found:
            yield found


@pytest.mark.skipif(not hasattr(os, "ST_NOEXEC"), reason="the system does not report ST_NOEXEC")
def test_a_folder_without_programs_is_left_out(place, tmp_path, monkeypatch, caplog):
    about = os.statvfs(tmp_path)
    flags = about.f_flag | os.ST_NOEXEC
    changed = os.statvfs_result((*about[:8], flags, about.f_namemax))
    monkeypatch.setattr(os, "statvfs", lambda _: changed)
    assert set(used_three_times(fill(tmp_path / "x.fmu"))) == {None}
    (note,) = notes(caplog)
    assert note.startswith(f"{place}: not used as a cache, no library can be loaded from it")


def full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def full_disk(monkeypatch, below):
    """Files below a folder can be made, but hold nothing."""
    real = open

    class Full(io.FileIO):
        def write(self, _):
            full()

    def opened(file, mode="r", *arguments, **options):
        named = isinstance(file, str | Path)
        if named and "w" in mode and Path(file).is_relative_to(below):
            return Full(file, "w")
        return real(file, mode, *arguments, **options)

    monkeypatch.setattr(io, "open", opened)
    monkeypatch.setattr("builtins.open", opened)


def test_a_full_cache_is_left_out(place, tmp_path, monkeypatch, caplog):
    path = fill(tmp_path / "x.fmu")
    full_disk(monkeypatch, place)
    assert set(used_three_times(path)) == {None}
    made = [cache.made("x", b"key", lambda path: path.write_bytes(b"made")) for _ in range(3)]
    assert {path.read_bytes() for path in made} == {b"made"}
    assert notes(caplog) == [
        f"{place}: not used as a cache, No space left on device "
        "(set HARNESS_CACHE to another folder)"
    ]
    assert entries(place) == []


def test_a_full_cache_is_found_where_a_file_is_made(place, monkeypatch, caplog):
    full_disk(monkeypatch, place)
    for key in (b"1", b"2"):
        path = cache.made("x.zip", key, lambda path, key=key: pack(path, {"a": key}))
        assert not path.is_relative_to(place)
        assert read_entry(path, "a") == key
    assert len(notes(caplog)) == 1


def test_an_error_while_making_an_entry_is_no_fault_of_the_cache(place, caplog):
    def fail(path):
        raise ResultsError("the compiler does not like it")

    with pytest.raises(ResultsError, match="the compiler does not like it"):
        cache.made("x", b"key", fail)
    assert notes(caplog) == []


def test_a_run_continues_without_a_full_cache(place, monkeypatch, caplog):
    required = run("sync_approach", stop=1.0).values.tobytes()
    shutil.rmtree(place)
    place.mkdir(mode=0o700)
    full_disk(monkeypatch, place)
    assert run("sync_approach", stop=1.0).values.tobytes() == required
    assert len(notes(caplog)) == 1


def test_a_cache_that_cannot_be_written_is_left_out(tmp_path, monkeypatch, caplog):
    """As below a home that is read-only."""
    monkeypatch.setenv("HARNESS_CACHE", "/proc/cache")
    assert set(used_three_times(fill(tmp_path / "x.fmu"))) == {None}
    (note,) = notes(caplog)
    assert note.startswith("/proc/cache: not used as a cache, ")


def test_a_home_that_cannot_be_written_is_reported(tmp_path, monkeypatch, caplog):
    monkeypatch.delenv("HARNESS_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc")
    assert set(used_three_times(fill(tmp_path / "x.fmu"))) == {None}
    (note,) = notes(caplog)
    assert note.startswith("/proc/servicing-fmus: not used as a cache, ")


def test_a_relative_path_of_caches_is_left_out(tmp_path, monkeypatch, caplog):
    """The specification of XDG_CACHE_HOME requires it to be ignored."""
    monkeypatch.delenv("HARNESS_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "caches")
    assert set(used_three_times(fill(tmp_path / "x.fmu"))) == {None}
    (note,) = notes(caplog)
    assert note.startswith("caches/servicing-fmus: not used as a cache, the path of XDG_CACHE_")
    assert not Path("caches").exists()


def test_a_full_temporary_folder_is_reported_as_one_error(make, place, tmp_path, monkeypatch):
    """Of an FMU that is not ours, whose files were copied from the cache."""
    system = make({"a": "counter"})
    assert len(run(system).time) == 7
    folder = tmp_path / "full"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    full_disk(monkeypatch, folder)
    with pytest.raises(ArchiveError, match=r"cannot be unpacked into .*No space left on device"):
        run(system)


# ---- FMUs


GLOBAL = Model(
    "sharing",
    [y("n"), p("k")],
    "n = total;",
    "total += 1;",
)
"""Counts the steps of all its instances in one global: of two copies each counts its own."""


def test_components_of_one_third_party_fmu_do_not_share_its_globals(
    make, place, tmp_path, monkeypatch
):
    source = f"static int total;\n{third_party_fmu.SOURCE_TEXT}"
    monkeypatch.setattr(third_party_fmu, "SOURCE_TEXT", source)
    path = build(GLOBAL, tmp_path)
    system = make({"a": "counter", "b": "counter"})
    system = replace(system, components=tuple(replace(c, fmu=path) for c in system.components))
    for _ in range(2):
        result = run(system)
        assert result["a.n"].tolist() == result["b.n"].tolist() == [0, 1, 2, 3, 4, 5, 6]
    with Simulation(system) as simulation:
        for _ in range(3):
            assert simulation.run()["a.n"].tolist() == [0, 1, 2, 3, 4, 5, 6]


def test_the_bits_match_a_run_without_cache(place, monkeypatch):
    retained = [run("sync_approach", stop=2.0) for _ in range(2)]
    monkeypatch.setenv("HARNESS_CACHE", "off")
    fresh = run("sync_approach", stop=2.0)
    assert {r.values.tobytes() for r in retained} == {fresh.values.tobytes()}
    assert {r.parameters.values.tobytes() for r in retained} == {fresh.parameters.values.tobytes()}
