# SPDX-License-Identifier: BSD-2-Clause
"""Numbers, disks and streams at their limits: a result or one line that states which limit."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import warnings
import zipfile
from pathlib import Path

import pytest

from harness import run
from harness.cli.app import main
from harness.errors import (
    ArchiveError,
    FmuError,
    ResultsError,
    StructureError,
    UsageError,
    exhausted,
)
from harness.files.archive import unpack
from harness.files.output import PrivateFolder
from harness.master.isolated import simulate
from harness.system.graph import checked
from harness.system.interface import read_interface
from harness.system.units import Unit, compose
from tests.harness.interrupts import LONGEST


@pytest.mark.parametrize("every", [2**31, 2**32 + 1, 2**64])
def test_rows_further_apart_than_the_run_is_long_leave_the_first_and_the_last(make, every):
    assert simulate(make({"a": "counter"}), every=every).time.tolist() == [0, 6]


@pytest.mark.parametrize("every", [2**31, 2**33])
def test_a_period_beyond_32_bits_is_rejected(make, every):
    system = make({"a": "counter"}, timing={"a": (every, 0)}, stop=float(every))
    with pytest.raises(StructureError, match=f"a: `every` must lie in 1..{2**31 - 1}"):
        checked(system)


@pytest.mark.parametrize(("stop", "step"), [(1e300, 1.0), (1e300, 1e-300), (1.0, 1e-310)])
def test_a_stop_time_beyond_all_macro_steps_is_rejected(make, stop, step):
    with pytest.raises(StructureError, match="is too many macro steps of"):
        checked(make({"a": "counter"}, stop=stop, step=step))


def test_a_table_beyond_all_memory_is_rejected(make):
    with pytest.raises(UsageError, match="do not fit into memory: record fewer rows with --every"):
        simulate(make({"a": "counter"}, stop=1e15))


def test_a_conversion_beyond_all_numbers_is_rejected():
    large, small = Unit("Gx", {"m": 1, "factor": 1e300}), Unit("fx", {"m": 1, "factor": 1e-300})
    with pytest.raises(ValueError, match="Gx to fx overflows"):
        compose(large, (), small)
    assert compose(small, (), large).factor == 0.0


def test_a_full_temporary_folder_is_not_called_damage(tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr("a", "a")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zipfile.ZipFile, "extractall", full)
    (tmp_path / "into").mkdir()
    with pytest.raises(ArchiveError, match=r"cannot be unpacked into .*No space left") as caught:
        unpack(tmp_path / "x.zip", tmp_path / "into")
    assert "damaged" not in str(caught.value)


def test_a_missing_temporary_folder_is_reported_in_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with pytest.raises(ResultsError, match="cannot create temporary files"):
        PrivateFolder()


def test_an_fmu_for_model_exchange_is_called_that(tmp_path, fmus):
    path = tmp_path / "exchange.fmu"
    with zipfile.ZipFile(fmus["gain"]) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode().replace('canHandleVariableCommunicationStepSize="true"', "")
                data = text.replace("<CoSimulation", "<ModelExchange").encode()
            new.writestr(name, data)
    with pytest.raises(FmuError, match=r"exchange\.fmu: supports model exchange only"):
        read_interface(path)


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b", "\udce4", "x" * 300 + ".ssp"])
def test_names_that_no_file_can_have_are_wrong_use(capsys, name):
    assert main(["run", name, "-o", "x.csv"]) == 2
    assert capsys.readouterr().err.endswith("there is no such system\n")


# ---- streams


def listed(shell):
    """`harness study` with its streams as the shell sets them: exit status and what stderr got."""
    command = f'"{sys.executable}" -m harness study {shell}'
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run(
        ["/bin/sh", "-c", command], env=environment, capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_standard_output_is_reported_in_one_line():
    assert listed(">/dev/full") == (
        1, "harness: standard output cannot be written (No space left on device)\n",
    )  # fmt: skip


@pytest.mark.skipif(os.name != "posix", reason="a shell")
def test_closed_streams_are_no_failure():
    assert listed("2>&-")[0] == 0
    assert listed(">&-")[0] == 0
    assert listed(">&- 2>&- <&-")[0] == 0


# ---- little memory, few files

LITTLE = """
system = "sync_approach"
runs = 2
[fixed]
stop = 1
[factors]
"servicer.mass_0" = {uniform = {low = 100, high = 120}}
[metrics]
rate = "max(norm(servicer.omega_SN_S))"
"""
SCARCE = {"n": "ulimit -n 12", "v": "ulimit -v 300000"}
COMMANDS = {
    "run": ["run", "sync_approach", "--stop", "1", "-o", "y.csv"],
    "campaign": ["campaign", "little.toml", "-o", "x.zarr"],
    "report": ["report", "x.nc", "-o", "x.html"],
    "list": ["list"],
}
FAIL = (("campaign", "n"), ("report", "v"))
"""Commands that need more; the others succeed. A campaign with little memory is among the long
tests: CPython 3.11 may repeat for ever the unwinding of an exception for which it has no memory.
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the limits of Linux")
@pytest.mark.parametrize(
    ("command", "limit"),
    [
        pytest.param(c, n, marks=() if (c, n) in FAIL else pytest.mark.long)
        for c in COMMANDS
        for n in SCARCE
    ],
)
def test_little_memory_and_few_files_cost_a_line(tmp_path, command, limit):
    """How much a library needs differs between machines: a command may succeed."""
    (tmp_path / "little.toml").write_text(LITTLE, encoding="utf-8")
    run("sync_approach", stop=1.0).save(tmp_path / "x.nc")
    given = ["sh", "-c", f'{SCARCE[limit]} && exec "$@"', "sh", sys.executable, "-m", "harness"]
    try:
        done = subprocess.run(
            [*given, *COMMANDS[command]],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired:
        pytest.skip("the interpreter does not return from an exception without memory")
    lines = [line for line in done.stderr.splitlines() if "not exercised" not in line]
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    if done.returncode:
        assert len(lines) == 1, done.stderr
    if (command, limit) == ("campaign", "n"):
        assert lines == [
            "harness: the number of open files is exhausted: close other programs or raise the"
            " limit (ulimit -n: 12)"
        ]


def test_an_exhausted_limit_is_named_wherever_it_was_met(capsys, monkeypatch):
    def caused_by(cause):
        error = ResultsError("x.nc: cannot be read")
        error.__cause__ = cause
        return error

    memory = (
        MemoryError(),
        OSError(errno.ENOMEM, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
        ImportError("libx.so: failed to map segment from shared object"),
        caused_by(MemoryError()),
    )
    files = (OSError(errno.EMFILE, "Too many open files"), OSError(errno.ENFILE, "Too many"))
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(threading, "excepthook", threading.excepthook)
    for error in (*memory, *files):

        def fail(*_, error=error, **__):
            raise error

        monkeypatch.setattr("harness.cli.app.group", lambda fail=fail: fail)
        with warnings.catch_warnings():
            assert main(["list"]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        name = "memory" if error in memory else "the number of open files"
        assert line.startswith(f"harness: {name} is exhausted: close other programs or raise the")
    for other in (ValueError("x"), OSError(errno.ENOSPC, "full"), caused_by(KeyError("x"))):
        assert exhausted(other) is None
