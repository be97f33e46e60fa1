# SPDX-License-Identifier: BSD-2-Clause
"""Components on emulated processors: the bits of this machine, and nothing left behind.

A machine without the cross compilers and emulators skips them; `make pil` installs these.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import zipfile

import psutil
import pytest

from harness import Simulation, load
from harness.cli.app import main
from harness.errors import FmuError, UsageError
from harness.files.paths import built, fmus
from harness.master.changes import apply
from harness.master.serve import Board
from harness.remote import firmware
from harness.remote.firmware import PROCESSORS, find_processor, missing
from harness.remote.places import _made
from tests.harness.interrupts import until
from tests.link.conftest import PATIENCE, simulated_twice_from

SYSTEM, STOP = "sync_approach", 30.0


def needs(*names):
    """A mark that skips where the tools of a processor are missing."""
    lacking = [text for name in names if (text := missing(PROCESSORS[name]))]
    return pytest.mark.skipif(bool(lacking), reason="; ".join(lacking))


def selected(*names):
    return [pytest.param(name, marks=needs(name)) for name in names]


def simulated(on, stop=STOP, system=SYSTEM, **changes):
    with load(system) as found, Simulation(found, on=on, stop=stop, **changes) as simulation:
        simulation.advance()
        return simulation.result()


def assert_same(on, **how):
    assert simulated(on, **how).values.tobytes() == simulated({}, **how).values.tobytes()


def emulators(process=None):
    """The emulators that a process, or this one, has started and that run."""
    kin = (process or psutil.Process()).children(recursive=True)
    return [p for p in kin if p.is_running() and p.name().startswith("qemu-system")]


@pytest.mark.parametrize("target", selected("cortex-m7"))
def test_the_controller_gives_the_same_bits_on(target):
    assert_same({"controller": target})
    assert not emulators()


@pytest.mark.pil
@pytest.mark.parametrize("target", selected(*PROCESSORS))
def test_guidance_and_controller_give_the_same_bits_on(target):
    assert_same({"controller": target, "guidance": target})


@pytest.mark.pil
@needs("cortex-m7")
def test_two_components_share_a_processor():
    on = {"controller": "cortex-m7:obc", "guidance": "cortex-m7:obc"}
    with load(SYSTEM) as system, Simulation(system, on=on, stop=STOP) as simulation:
        simulation.advance(to=10)
        assert len(emulators()) == 1
        simulation.advance()
        result = simulation.result()
    assert result.values.tobytes() == simulated({}).values.tobytes()
    assert not emulators()


@pytest.mark.pil
@needs("cortex-m7", "riscv32")
def test_two_components_on_two_processors():
    assert_same({"controller": "cortex-m7", "guidance": "riscv32"}, algorithm="jacobi")


@pytest.mark.pil
@needs("cortex-m7")
def test_a_snapshot_with_a_processor_continues_bit_for_bit():
    on = {"controller": "cortex-m7"}
    with load(SYSTEM) as system, Simulation(system, on=on, stop=STOP) as simulation:
        first = simulated_twice_from(simulation, 100, 200).values.tobytes()
        again = simulation.run(on=on, stop=STOP).values.tobytes()
    assert first == again == simulated({}).values.tobytes()


@pytest.mark.pil
@needs("cortex-m7")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_the_emulator_ends_with_the_harness_for_any_signal(tmp_path, number):
    code = (
        "from harness import Simulation, load\n"
        "with load('sync_approach') as s, Simulation(s, on=['controller=cortex-m7']) as it:\n"
        "    it.advance(to=10)\n"
        "    print('running', flush=True)\n"
        "    input()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "TMPDIR": str(tmp_path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdout.readline() == b"running\n"
    started = emulators(psutil.Process(process.pid))
    keepers = psutil.Process(process.pid).children()
    assert len(started) == 1
    process.send_signal(number)
    process.communicate()
    _, alive = psutil.wait_procs([*started, *keepers], timeout=30)
    assert not [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]
    assert not list(tmp_path.glob("slnk-*"))


@pytest.mark.pil
@needs("cortex-m7")
def test_an_emulator_that_fails_is_reported_as_one_error():
    with load(SYSTEM) as system, Simulation(system, on={"controller": "cortex-m7"}) as simulation:
        simulation.advance(to=10)
        emulators()[0].kill()
        with pytest.raises(Exception, match="cortex-m7: the connection has ended") as caught:
            simulation.advance(to=12)
    assert str(caught.value).isprintable()  # its last words are one line, without an end


NO_FORK = """
#define _GNU_SOURCE
#include <errno.h>
#include <unistd.h>
pid_t fork(void) { return errno = EAGAIN, -1; }
"""

INSTANTIATE = """
import ctypes, sys
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
logger = fmi2CallbackLoggerTYPE(lambda _a, _b, _c, _d, text: print(text.decode()))
calls = fmi2CallbackFunctions(logger=logger)
instantiate = ctypes.CDLL(sys.argv[1]).fmi2Instantiate
instantiate.restype = ctypes.c_void_p
assert instantiate(b"x", 1, b"guid", sys.argv[2].encode(), ctypes.byref(calls), 0, 0) is None
"""


@pytest.mark.skipif(sys.platform != "linux", reason="exchanges fork by the loader of Linux")
@pytest.mark.parametrize(
    ("argument", "reported"),
    [
        (sys.executable, "fork (Resource temporarily unavailable)"),
        ("/no/emulator", "/no/emulator (No such file or directory)"),
    ],
)
def test_an_emulator_that_cannot_be_started_leaves_nothing(tmp_path, argument, reported):
    """No keeper could be made, or it would have nothing to start: one line, at once."""
    (tmp_path / "no_fork.c").write_text(NO_FORK)
    library = tmp_path / "no_fork.so"
    build = ["gcc", "-shared", "-fPIC", str(tmp_path / "no_fork.c"), "-o", str(library)]
    subprocess.run(build, check=True)
    settings = f"guid=guid\nvia=emulator\ntarget=none\ntimeout=20\nargument={argument}\n"
    (tmp_path / "link.txt").write_text(settings)
    (tmp_path / "tmp").mkdir()
    done = subprocess.run(
        [sys.executable, "-c", INSTANTIATE, str(built("link")), str(tmp_path)],
        env={**os.environ, "TMPDIR": str(tmp_path / "tmp"), "LD_PRELOAD": str(library)},
        capture_output=True,
        text=True,
        check=True,
    )
    started = "fmi2Instantiate: none: the emulator cannot be started: "
    assert done.stdout == f"{started}{reported}\n"
    assert list((tmp_path / "tmp").iterdir()) == []


EMULATOR = """
import os, sys
from pathlib import Path
from harness.master.serve import Board

fmu, to_board, from_board = map(Path, sys.argv[1:])
with Board(fmu) as board, to_board.open("rb", 0) as reads, from_board.open("wb", 0) as writes:
    board.answer(reads.read, writes.write)
"""


def behind_pipes(group, *command):
    """The controller as a link to what a command starts, which communicates over two pipes."""
    settings = [("via", "emulator"), ("target", "native"), ("group", group), ("timeout", "60")]
    return _made(
        fmus()["adaptive_controller"], [*settings, *(("argument", a) for a in command)], b""
    )


@pytest.mark.parametrize("group", ["", "alone"])
def test_a_started_board_over_pipes_gives_the_same_bits(tmp_path, monkeypatch, group):
    """As an emulator, without one: started by the keeper, which leaves nothing behind."""
    (tmp_path / "emulator.py").write_text(EMULATOR)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(p for p in sys.path if p))
    program = [sys.executable, str(tmp_path / "emulator.py"), str(fmus()["adaptive_controller"])]
    fmu = behind_pipes(group, *program, "%/to_board", "%/from_board")
    with load(SYSTEM) as system:
        changed = apply(system, swap={"controller": fmu}, stop=3.0)
        with Simulation(changed) as simulation:
            simulation.advance(to=5)
            assert len(list((tmp_path / "tmp").glob("slnk-*"))) == 1
            simulation.advance()
            result = simulation.result()
    assert result.values.tobytes() == simulated({}, 3.0).values.tobytes()
    until(lambda: not list((tmp_path / "tmp").glob("slnk-*")), "end of the keeper")


def test_a_link_that_joins_waits_until_the_keeper_is_ready(tmp_path, monkeypatch):
    """The folder of a shared board is there already, its pipes come later: made by another thread,
    which is the board too.
    """
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    folder = tmp_path / f"slnk-{os.getpid()}-shared"
    folder.mkdir(mode=0o700)
    requested = threading.Event()

    def board():
        requested.wait()
        time.sleep(0.3)  # as long as the link is here, it waits
        for name in ("to_board", "from_board", "life"):
            os.mkfifo(folder / name, 0o600)
        life = os.open(folder / "life", os.O_RDWR)
        with (
            Board(fmus()["adaptive_controller"]) as found,
            (folder / "to_board").open("rb", 0) as reads,
            (folder / "from_board").open("wb", 0) as writes,
        ):
            found.answer(reads.read, writes.write)
        for _ in "jq":  # the link leaves after its pipes have ended
            reported.append(os.read(life, 1))
        os.close(life)

    reported = []
    worker = threading.Thread(target=board, daemon=True)
    worker.start()
    fmu = behind_pipes("shared", "/no/emulator")
    with load(SYSTEM) as system:
        changed = apply(system, swap={"controller": fmu}, stop=1.0)
        requested.set()
        with Simulation(changed) as simulation:
            simulation.advance()
            result = simulation.result()
    worker.join(PATIENCE)
    assert result.values.tobytes() == simulated({}, 1.0).values.tobytes()
    assert reported == [b"j", b"q"]


def test_missing_tools_are_named_with_their_packages(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(UsageError) as caught:
        find_processor("cortex-m7")
    assert str(caught.value) == (
        "cortex-m7 needs arm-none-eabi-gcc and arm-none-eabi-objcopy and qemu-system-arm: make "
        "pil, or apt-get install gcc-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm"
    )


def fake_tools(folder, target, specs):
    """Programs of these names that do nothing but say where the C library is."""
    for tool in (target.compiler, f"{target.tools}objcopy", target.emulator[0]):
        (folder / tool).write_text(f"#!/bin/sh\necho {specs}\n")
        (folder / tool).chmod(0o755)


@pytest.mark.parametrize(
    ("specs", "reported"),
    [
        ("/lib/picolibc.specs", "riscv32: RISC-V RV32GC, doubles in hardware: ready"),
        (
            "picolibc.specs",
            "riscv32 needs picolibc of riscv64-unknown-elf-gcc: make pil, or apt-get install "
            "gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc",
        ),
    ],
)
def test_check_states_what_this_machine_lacks(tmp_path, monkeypatch, capsys, specs, reported):
    fake_tools(tmp_path, PROCESSORS["riscv32"], specs)
    monkeypatch.setenv("PATH", str(tmp_path))
    firmware._has_library.cache_clear()
    status = main(["check"])
    firmware._has_library.cache_clear()
    lines = capsys.readouterr().out.splitlines()
    assert status == 0
    assert len(lines) == len(PROCESSORS)
    assert lines[0].startswith("cortex-m7 needs arm-none-eabi-gcc and ")
    assert lines[2] == reported


def test_check_of_nothing_takes_no_changes():
    assert main(["check", "--strict"]) == UsageError.exit_status


def rebuilt(target, change):
    """The controller with other files; change(name, content) gives the new content, or None."""
    with zipfile.ZipFile(fmus()["adaptive_controller"]) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            if (content := change(name, old.read(name))) is not None:
                new.writestr(name, content)
    return target


@needs("cortex-m7")
def test_an_fmu_without_sources_is_rejected(tmp_path):
    bare = rebuilt(tmp_path / "bare.fmu", lambda n, c: None if n.startswith("sources/") else c)
    unlisted = r"bare.fmu: .*adaptive_controller.c.*which the FMU lacks"
    with load(SYSTEM) as system, pytest.raises(FmuError, match=unlisted):
        apply(system, swap={"controller": bare}, on={"controller": "cortex-m7"})


@needs("cortex-m7")
def test_an_fmu_that_needs_an_operating_system_is_rejected_in_one_line(tmp_path):
    def change(name, content):
        return b"#include <sys/socket.h>\n" + content if name.endswith("/fmi2.c") else content

    fmu = rebuilt(tmp_path / "hosted.fmu", change)
    with load(SYSTEM) as system, pytest.raises(FmuError) as caught:
        apply(system, swap={"controller": fmu}, on={"controller": "cortex-m7"})
    assert str(caught.value) == (
        "hosted.fmu does not compile for cortex-m7: fmi2.c:1:10: fatal error: socket.h: No such "
        "file or directory"
    )
