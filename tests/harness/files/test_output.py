# SPDX-License-Identifier: BSD-2-Clause
"""Nothing is lost: files are the old ones or the new ones, whole, whichever way the program
ends.
"""

from __future__ import annotations

import os
import random
import re
import signal
import stat
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

from harness.cli.app import main
from harness.errors import ResultsError
from harness.files import signals
from harness.files.output import PrivateFolder, process_state, written
from harness.results import files
from harness.results.files import ResultFile, read, save
from harness.results.formats import netcdf
from harness.results.result import Result
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from tests.harness.interrupts import LONGEST, heard, start, until

posix = pytest.mark.skipif(os.name != "posix", reason="signals and modes of POSIX")


def table(rows=5, names=("a.x",), complete=True):
    values = np.arange(rows * len(names), dtype=float).reshape(rows, len(names))
    return Result(
        "t", np.arange(rows) * 1.0, names, ("",) * len(names), values, (), complete, "why"
    )


# ---- a file that is written


@posix
def test_a_link_is_followed_and_the_mode_retained(tmp_path):
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    target.write_text("old")
    target.chmod(0o600)
    link.symlink_to("target.txt")
    with written(link) as file:
        file.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o600


@posix
def test_a_planted_link_under_a_temporary_name_is_not_followed(tmp_path):
    with written(tmp_path / "x.txt") as file:
        assert file.parent == tmp_path
        assert not file.is_symlink()
        first = file.name
    with written(tmp_path / "x.txt") as file:
        assert file.name != first


def test_a_failure_leaves_the_old_file_and_nothing_beside(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), written(path) as file:
        file.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform != "linux", reason="the state of a process is in /proc")
def test_files_of_a_process_that_has_ended_but_is_still_listed_are_removed(tmp_path):
    """A killed worker remains listed, as a zombie, until its parent or init has read its status."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    until(lambda: process_state(ended.pid) == "Z", "zombie")
    left = tmp_path / f".x-{ended.pid}-0123456789ab.txt"
    left.touch()
    with written(tmp_path / "x.txt") as file:
        file.write_text("new")
    assert not left.exists()
    ended.wait()
    assert process_state(ended.pid) == ""


def test_files_of_a_killed_process_are_removed_by_the_next(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = tmp_path / f".x-{ended.pid}-0123456789ab.txt"
    others = [
        tmp_path / f".x-{os.getpid()}-0123456789ab.txt",  # of a process that still writes
        tmp_path / f".y-{ended.pid}-0123456789ab.txt",
        tmp_path / ".x-notes.txt",
    ]
    for file in (left, *others):
        file.write_text("")
    with written(tmp_path / "x.txt") as file:
        file.write_text("new")
    assert not left.exists()
    assert all(file.exists() for file in others)


@posix
def test_every_handler_is_restored_if_a_signal_arrives_meanwhile(monkeypatch):
    """Another thread may have received it, so that it is handled later than it was sent."""
    with heard(), signals.as_interrupts():
        before = {number: signal.getsignal(number) for number in signals.NUMBERS}
        given, late = signal.signal, []

        def interrupted(number, handler):
            given(number, handler)
            if late and late.pop():
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt), signals.held():
            late.append(True)
            monkeypatch.setattr(signal, "signal", interrupted)
        monkeypatch.undo()
        assert {number: signal.getsignal(number) for number in signals.NUMBERS} == before


@posix
@pytest.mark.parametrize("number", signals.NUMBERS)
def test_signals_wait_until_the_file_is_complete_a_second_one_too(tmp_path, number):
    with heard():
        with signals.as_interrupts(), pytest.raises(KeyboardInterrupt):
            with written(tmp_path / "x.txt") as file:
                file.write_text("first half, ")
                for _ in range(2):
                    os.kill(os.getpid(), number)
                    time.sleep(0.01)
                file.write_text("whole")
            pytest.fail("the signal was lost")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert (tmp_path / "x.txt").read_text() == "whole"


@posix
def test_an_ignored_hang_up_stays_ignored(tmp_path):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with signals.as_interrupts(), written(tmp_path / "x.txt") as file:
            os.kill(os.getpid(), signal.SIGHUP)
            file.write_text("x")
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (tmp_path / "x.txt").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("command", "name"),
    [
        (("draw", "long.ssp", "-o"), "x.svg"),
        (("export", "long.ssp"), "x.ssp"),
        (("linearize", "slow.fmu", "-o"), "x.npz"),
    ],
)
def test_a_full_device_is_reported_in_one_line_and_stays_a_device(
    work, fmus, monkeypatch, capsys, command, name
):
    monkeypatch.chdir(work)
    (work / "slow.fmu").symlink_to(fmus["slow"])
    (work / name).symlink_to("/dev/full")
    assert main([*command, name]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"harness: {name}: cannot be written (No space left")
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)


def test_control_characters_in_an_export_are_reported_in_one_line(fmus, work, monkeypatch, capsys):
    monkeypatch.chdir(work)
    toml = 'name = "m"\n[experiment]\nstop = 1.0\nstep = 1.0\n[components]\na = "mixed"\n[open]\n'
    toml += '"a.i" = 0\n"a.b" = false\n"a.r" = 0.0\n'
    write_ssp(system_of(tomllib.loads(toml), fmus), work / "m.ssp")
    (work / "copy.ssp").write_text("old")
    for text in ("\x01", "\udce4", "\x00"):
        assert main(["export", "m.ssp", "copy.ssp", "--set", f"a.label={text}"]) in (1, 2)
        (line,) = capsys.readouterr().err.splitlines()
        required = r"harness: (value '\\x01': contains a character that|--set a\.label: )"
        assert re.match(required, line)
        assert (work / "copy.ssp").read_text() == "old"


# ---- results


def test_an_incomplete_run_is_stored_beside_a_complete_one(tmp_path):
    file = ResultFile(tmp_path / "x.nc")
    file.write(table())
    old = (tmp_path / "x.nc").read_bytes()
    assert file.write_partial(table(rows=2, complete=False)) == (tmp_path / "x.partial.nc", None)
    assert (tmp_path / "x.nc").read_bytes() == old
    assert not read(tmp_path / "x.partial.nc").complete
    file.write(table(rows=3))
    assert [path.name for path in tmp_path.iterdir()] == ["x.nc"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_finished_run_is_not_lost_to_a_full_disk(tmp_path, monkeypatch):
    (tmp_path / "stored").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "stored"))
    (tmp_path / "full.csv").symlink_to("/dev/full")
    with pytest.raises(ResultsError, match=r"No space left.*; the results are in .*\.csv"):
        ResultFile(tmp_path / "full.csv").write(table())
    (retained,) = (tmp_path / "stored").iterdir()
    assert read(retained)["a.x"].tolist() == list(range(5))


def test_an_incomplete_result_that_is_stored_elsewhere_is_at_the_path_that_save_returns(
    tmp_path, monkeypatch
):
    def reject(*_):
        raise RuntimeError("NetCDF: no")

    monkeypatch.setattr(netcdf, "write", reject)
    path = save(table(rows=2, complete=False), tmp_path / "x.nc")
    assert read(path)["a.x"].tolist() == [0, 1]


def test_a_finished_run_is_not_lost_to_a_format(tmp_path, monkeypatch):
    def reject(*_):
        raise RuntimeError("NetCDF: no")

    monkeypatch.setattr(netcdf, "write", reject)
    problem = r"x\.nc: cannot be written \(NetCDF: no\).*the results are in"
    with pytest.raises(ResultsError, match=problem):
        ResultFile(tmp_path / "x.nc").write(table())
    (retained,) = tmp_path.iterdir()
    assert read(retained)["a.x"].tolist() == list(range(5))


def test_a_run_that_can_be_written_nowhere_is_an_error(tmp_path, monkeypatch):
    def reject(*_):
        raise RuntimeError("no")

    for kind in files.FORMATS.values():
        monkeypatch.setattr(kind, "write", reject)
    with pytest.raises(ResultsError, match=r"x\.nc: cannot be written \(no\)$"):
        ResultFile(tmp_path / "x.nc").write(table())
    assert list(tmp_path.iterdir()) == []


ODD = ["p/q", "new\nline", "x[4000000000]", "x[99999999999999999999]", "trailing ", "a²[²]"]


@pytest.mark.parametrize("ending", [".csv", ".nc"])
@pytest.mark.parametrize("name", ODD)
def test_a_name_is_found_before_the_run_or_retained(tmp_path, monkeypatch, name, ending):
    file = ResultFile(tmp_path / f"x{ending}")
    odd = Result("t", np.arange(2.0), (f"a.{name}",), ("",), np.ones((2, 1)))
    if ending == ".nc" and name in ("p/q", "new\nline", "trailing "):
        monkeypatch.setattr(files, "read_interfaces", lambda _: {"a": _Interface((name,))})
        with pytest.raises(ResultsError, match=r"a \.nc cannot store the names 'a\."):
            file.accept(None)
        return
    file.write(odd)
    back = read(tmp_path / f"x{ending}")
    assert back.columns == odd.columns
    assert back[f"a.{name}"].tolist() == [1, 1]


@pytest.mark.parametrize(("count", "rest"), [(5, ";"), (6, " and 1 more;"), (9, " and 4 more;")])
def test_the_first_five_names_that_a_file_cannot_hold_are_shown(monkeypatch, count, rest):
    bad = [f"p/{k}" for k in range(count)]
    monkeypatch.setattr(files, "read_interfaces", lambda _: {"a": _Interface(("good", *bad))})
    with pytest.raises(ResultsError) as caught:
        ResultFile(Path("x.nc")).accept(None)
    shown = ", ".join(f"'a.p/{k}'" for k in range(5))
    assert str(caught.value).startswith(f"x.nc: a .nc cannot store the names {shown}{rest}")


def test_names_that_a_netcdf_file_retains_as_they_are(tmp_path):
    for name in ("n" * 200, "\u00e9", "x[1]", "a b"):
        assert netcdf.fits(name)
        result = Result("t", np.arange(2.0), (name,), ("",), np.ones((2, 1)))
        result.save(tmp_path / "x.nc")
        assert read(tmp_path / "x.nc").columns == (name,)
    for name in ("n" * 201, "e\u0301", "a ", "p/q", " a", "a\x7f"):
        assert not netcdf.fits(name), name


class _Interface:
    """Members that accept() requires of an interface."""

    def __init__(self, names):
        self.names = names

    def outputs(self):
        return dict.fromkeys(self.names)

    def named(self, _):
        return {}


# ---- arrays that begin at 0


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("comma", [",", ", "])
def test_arrays_retain_all_elements_in_their_places_wherever_they_begin(tmp_path, first, comma):
    names = [f"a.v[{i + first}]" for i in range(3)]
    names += [f"a.J[{i + first}{comma}{j + first}]" for i in range(2) for j in range(2)]
    result = table(names=tuple(names))
    assert result["a.v"].tolist() == result.values[:, :3].tolist()
    assert result["a.J"][0].tolist() == [[3, 4], [5, 6]]
    for ending in (".nc", ".csv"):
        ResultFile(tmp_path / f"x{ending}").write(result)
        back = read(tmp_path / f"x{ending}")
        assert set(back.columns) == set(names)
        for name in (*names, "a.v", "a.J"):
            assert back[name].tolist() == result[name].tolist(), name


# ---- kills at any moment

RUN = ("run", "long.ssp", "-o", "out/x.nc", "--stop", "400", "-q")
COMPARE = (
    "compare",
    "long.ssp",
    "--algorithm",
    "jacobi,gauss-seidel",
    "-o",
    "out",
    "-q",
    "--stop",
    "400",
)


@pytest.fixture
def work(tmp_path, fmus):
    """A folder with a system of a slow FMU, and with temporary files of its own."""
    (tmp_path / "scratch").mkdir()
    toml = 'name = "long"\n[experiment]\nstop = 400.0\nstep = 1.0\n[components]\na = "slow"\n'
    write_ssp(system_of(tomllib.loads(toml), fmus), tmp_path / "long.ssp")
    return tmp_path


def started(work, arguments):
    return start(
        [sys.executable, "-m", "harness", *arguments],
        cwd=work,
        env=os.environ
        | {
            "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
            "TMPDIR": str(work / "scratch"),
        },
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def kill_and_check(work, arguments, seconds, number):
    """Kill the command after a while; then its files must be whole, and the next start clean."""
    running = started(work, arguments)
    time.sleep(seconds)
    running.send_signal(number)
    _, err = running.communicate(timeout=LONGEST)
    if "Traceback" in err:  # of Python itself, which had not reached our first line
        assert number == signal.SIGINT
        assert not re.search(r"harness.*, in main", err), err
    assert "internal error" not in err
    for file in (work / "out").glob("[!.]*.nc"):
        assert read(file).complete == (".partial" not in file.name), file
    again = started(work, arguments)
    _, err = again.communicate(timeout=LONGEST)
    assert again.returncode == 0, err
    until(lambda: not any((work / "scratch").iterdir()), "empty folder")
    assert not [p for p in (work / "out").iterdir() if p.name.startswith(".")]
    assert not [p for p in (work / "out").iterdir() if ".partial" in p.name]


@posix
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_run_leaves_whole_files_only(work, number):
    kill_and_check(work, RUN, 0.9, number)


@posix
@pytest.mark.long
@pytest.mark.parametrize("arguments", [RUN, COMPARE], ids=["run", "compare"])
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT], ids=str
)
@pytest.mark.parametrize("seed", range(50))
def test_kills_at_random_moments(work, arguments, number, seed):
    kill_and_check(work, arguments, random.Random(seed).uniform(0.05, 6.0), number)


@posix
@pytest.mark.parametrize("number", signals.NUMBERS)
def test_a_signal_while_results_are_written_loses_nothing(work, monkeypatch, capsys, number):
    """Twice, in the middle of the file."""
    monkeypatch.chdir(work)
    writer = netcdf.write

    def interrupted(result, path):
        for _ in range(2):
            os.kill(os.getpid(), number)
        writer(result, path)

    monkeypatch.setattr(netcdf, "write", interrupted)
    with heard():
        assert main(["run", "long.ssp", "-o", "x.nc", "--stop", "3"]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("long: 3 s in")
    assert err == "harness: interrupted\n"
    assert read(work / "x.nc").complete
    assert not list(work.glob(".x-*"))


def test_a_comparison_deletes_nothing_before_it_starts_and_leaves_no_old_table_beside_new_runs(
    work, monkeypatch
):
    from harness.studies import compare as study
    from harness.studies.variants import combinations

    out = work / "out"
    out.mkdir()
    for name in ("jacobi.nc", "comparison.csv"):
        (out / name).write_text("old")
    variants = combinations({"stop": 3.0}, [("algorithm", "jacobi,gauss-seidel")])
    with pytest.raises(Exception, match="must be at least 1"):
        study.compare(work / "long.ssp", variants, out, every=0)
    assert {p.name: p.read_text() for p in out.iterdir()} == {
        "jacobi.nc": "old",
        "comparison.csv": "old",
    }
    monkeypatch.setattr(study, "write_csv", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        study.compare(work / "long.ssp", variants, out)
    assert sorted(p.name for p in out.iterdir()) == ["gauss-seidel.nc", "jacobi.nc"]
    assert read(out / "jacobi.nc").complete


@posix
def test_a_kill_between_guard_and_folder_leaves_no_folder(tmp_path):
    """The guard is there before the folder is, so there is no moment in which it would not be
    removed.
    """
    code = (
        "import os, signal, pathlib; from harness.files.output import PrivateFolder\n"
        "m = pathlib.Path.mkdir\n"
        "def mkdir(*a, **k): m(*a, **k); os.kill(os.getpid(), signal.SIGKILL)\n"
        "pathlib.Path.mkdir = mkdir; PrivateFolder()"
    )
    paths = os.pathsep.join(p for p in sys.path if p)
    subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": paths, "TMPDIR": str(tmp_path)},
        check=False,
    )
    until(lambda: not any(tmp_path.iterdir()), "empty folder")


@posix
def test_workers_start_where_the_path_of_temporary_files_is_longer_than_a_socket_permits(work):
    scratch = work / "scratch" / ("x" * 100)
    scratch.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "harness", *COMPARE[:-1], "3"],
        cwd=work,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "TMPDIR": str(scratch)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    until(lambda: not any(scratch.iterdir()), "empty folder")


@posix
def test_a_private_folder_in_a_short_place_has_the_rights_of_any_other(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with PrivateFolder(len(str(tmp_path)) + len("/harness-0123456789abcdef")) as folder:
        assert folder.parent == tmp_path
    with PrivateFolder(len(str(tmp_path))) as folder:
        assert folder.parent == Path("/tmp")
        assert folder.stat().st_mode & 0o777 == 0o700
    assert not folder.exists()


@posix
@pytest.mark.parametrize("last", ["del folder; gc.collect()", ""])
def test_a_folder_that_nobody_closes_leaves_neither_files_nor_a_guard(tmp_path, last):
    """Whether it is forgotten during the run, or held by the process until its end."""
    code = "import gc; from harness.files.output import PrivateFolder\n"
    code += f"folder = PrivateFolder()\n{last}"
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ | {"PYTHONPATH": paths, "TMPDIR": str(tmp_path)},
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    assert not any(tmp_path.iterdir())
