# SPDX-License-Identifier: BSD-2-Clause
"""One third-party FMU with many vices, in every phase of its life: each costs one line, no rows, no
other run and no earlier file.
"""

from __future__ import annotations

import io
import itertools
import os
import shutil
import signal
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from harness.files import paths
from harness.master import child
from harness.master.child import OUTCOME, Child
from harness.results.files import read
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from tests.each import each
from tests.harness import vices
from tests.harness.interrupts import LONGEST, start, until
from tests.harness.vices import CRASH, FAIL, HANG, NO_STATUS, PHASES, QUIET, VICES

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="vices of Linux")

TOML = """
name = "two"
[experiment]
stop = 6.0
step = 1.0
[components]
a = "good"
b = "vicious"
[connections]
"a.u" = "b.y"
"b.u" = "a.y"
[parameters.b]
k = 0.0
"""
STEPS = {"fmi2DoStep": 2, "fmi2GetReal": 6, "fmi2SetReal": 5}
"""Calls that go well before the vice shows, so that there are rows to store."""

AT_WORK = ("fmi2SetReal", "fmi2GetReal", "fmi2DoStep")
AFTER_THE_RUN = ("fmi2Terminate", "fmi2FreeInstance")
OLD = b"an earlier file"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With two.ssp, whose second component may have vices, and its two FMUs."""
    folder = tmp_path_factory.mktemp("vices")
    vicious, good = vices.build(folder)
    system = system_of(tomllib.loads(TOML), {"vicious": vicious, "good": good})
    write_ssp(system, folder / "two.ssp")
    return folder


def environment(vice="", phase="", after=0, **further):
    return os.environ | {
        "VICE": vice,
        "PHASE": phase,
        "AFTER": str(after),
        "PYTHONPATH": os.pathsep.join(p for p in sys.path if p),
        **further,
    }


def harness(folder, *arguments, **about):
    """Run the command in a session of its own; exit status, lines of stdout and of stderr."""
    done = subprocess.run(
        [sys.executable, "-m", "harness", *map(str, arguments)],
        cwd=folder,
        env=environment(**about),
        capture_output=True,
        check=False,
        timeout=LONGEST,
        start_new_session=True,
    )
    return done.returncode, done.stdout.decode().splitlines(), done.stderr.decode().splitlines()


def in_process(folder, *arguments, **about):
    """The same in a fork of the test, which saves the start of Python."""
    out, err = folder / "stdout", folder / "stderr"
    process = os.fork()
    if process == 0:
        os.setsid()
        os.chdir(folder)
        os.environ.update(environment(**about))
        for number, file in ((1, out), (2, err)):
            os.dup2(os.open(file, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), number)
        sys.stdout, sys.stderr = (os.fdopen(n, "w", closefd=False) for n in (1, 2))
        from harness.cli.app import main

        status = main([str(a) for a in arguments])
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    try:
        status = until(lambda: ended(process), f"end of {arguments}")
    except AssertionError:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        raise
    return status[0], *(f.read_text(errors="replace").splitlines() for f in (out, err))


def ended(process):
    """The status of a child that has ended, in a tuple."""
    pid, status = os.waitpid(process, os.WNOHANG)
    return (os.waitstatus_to_exitcode(status),) if pid else ()


def shows(vice, phase):
    """Whether a vice makes a difference in this phase: some functions have no status."""
    return not (VICES[vice].kind == FAIL and phase in (*NO_STATUS, *AFTER_THE_RUN, "load"))


def rows_before(phase):
    """Rows that must survive."""
    return 1 if phase in AT_WORK else 0


def check_run(folder, vice, phase, outcome):
    status, out, err = outcome
    kind, old = VICES[vice].kind, (folder / "x.csv").read_bytes()
    ends_run = kind in (CRASH, FAIL) and shows(vice, phase) and phase not in AFTER_THE_RUN
    assert not any("Traceback" in line or "internal error" in line for line in err), err
    assert all(line.startswith("harness: ") for line in err), err
    assert len(err) <= 1 + (kind == QUIET), err
    if not ends_run:
        assert (status, len(out)) == (0, 1), err
        whole = read(folder / "x.csv")
        assert whole.complete
        assert whole["b.y"].tolist() == list(np.arange(7.0))
        return
    assert (status, out, len(err)) == (1, [], 1), err
    assert "b:" in err[0]
    assert old == OLD
    if rows_before(phase):
        retained = read(folder / "x.partial.csv")
        assert not retained.complete
        assert len(retained.time) >= rows_before(phase)
        assert retained["b.y"].tolist() == list(np.arange(float(len(retained.time))))


def run_with(folder, vice, phase, call=in_process):
    (folder / "x.csv").write_bytes(OLD)
    (folder / "x.partial.csv").unlink(missing_ok=True)
    return call(
        folder, "run", "two.ssp", "-o", "x.csv", vice=vice, phase=phase, after=STEPS.get(phase, 0)
    )


NOT_ENDLESS = [name for name, vice in VICES.items() if vice.kind != HANG]
CASES = list(itertools.product(NOT_ENDLESS, PHASES))
SOME = [case for i, case in enumerate(CASES) if i % (2 * len(PHASES) + 1) == 0]
"""A diagonal of the matrix, with every phase twice and every other vice once."""


@pytest.mark.parametrize(("vice", "phase"), SOME)
def test_a_fault_costs_one_line_and_no_rows(folder, vice, phase):
    check_run(folder, vice, phase, run_with(folder, vice, phase))


@pytest.mark.long
@pytest.mark.parametrize("vice", NOT_ENDLESS)
@each("phase", PHASES)
def test_every_vice_in_every_phase_of_a_run(folder, vice, phase):
    check_run(folder, vice, phase, run_with(folder, vice, phase))


def test_the_sample_has_every_phase_and_nearly_half_of_the_vices():
    assert len({vice for vice, _ in SOME}) >= 0.45 * len(NOT_ENDLESS)
    assert {phase for _, phase in SOME} == set(PHASES)


@pytest.mark.parametrize(
    "phase",
    [pytest.param("fmi2Instantiate", marks=pytest.mark.long), "fmi2DoStep", "fmi2Terminate"],
)
def test_exit_0_inside_an_fmu_does_not_end_the_program_with_success(folder, phase):
    status, _, err = outcome = run_with(folder, "exit_0", phase, harness)
    check_run(folder, "exit_0", phase, outcome)
    assert "exit(0)" in err[0]
    assert (status == 0) == (phase == "fmi2Terminate")


def test_the_line_names_component_function_time_and_last_words(folder):
    _, _, err = run_with(folder, "last_words", "fmi2DoStep")
    assert err == [
        "harness: b: fmi2DoStep crashed (SIGABRT, aborted), its last output: ran out of fuel "
        "(at t = 2 s); 3 recorded rows are in x.partial.csv"
    ]


def _talk(send):
    print("one\ntwo")
    print("three", flush=True)


def test_lines_that_fmus_write_are_counted(caplog):
    with Child(_talk) as child:
        assert [kind for kind, _ in child.messages() if kind] == [OUTCOME]
        child.report_output()
    assert caplog.messages == ["the FMUs wrote 3 lines, the last: three"]


# ---- endless loops


ENDLESS = ("fmi2Instantiate", "fmi2DoStep", "fmi2Terminate")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.mark.parametrize(
    ("phase", "number"),
    [
        pytest.param(phase, number, marks=() if i == k else pytest.mark.long)
        for i, phase in enumerate(ENDLESS)
        for k, number in enumerate(SIGNALS)
    ],
)
def test_an_endless_loop_ends_at_once_and_retains_the_rows(folder, tmp_path, phase, number):
    vice = "endless_loop" if number == signal.SIGINT else "endless_sleep"
    trace = tmp_path / "trace"
    (folder / "x.csv").write_bytes(OLD)
    (folder / "x.partial.csv").unlink(missing_ok=True)
    running = start(
        [sys.executable, "-m", "harness", "run", "two.ssp", "-o", "x.csv"],
        cwd=folder,
        env=environment(vice, phase, STEPS.get(phase, 0), TRACE=str(trace)),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    until(trace.exists, "call")
    running.send_signal(number)
    out, err = running.communicate(timeout=LONGEST)  # the FMU would go on for ever
    if phase == "fmi2Terminate":
        assert (running.returncode, len(out.splitlines()), err) == (0, 1, "")
        assert read(folder / "x.csv").complete
        return
    assert (running.returncode, out) == (1, "")
    assert err.startswith("harness: two: interrupted")
    assert len(err.splitlines()) == 1
    assert (folder / "x.csv").read_bytes() == OLD
    if phase == "fmi2DoStep":
        assert read(folder / "x.partial.csv").time.tolist() == [0.0, 1.0, 2.0]


# ---- the other commands


def check_compare(folder, out, outcome, vice, phase):
    status, _, err = outcome
    ends_run = VICES[vice].kind in (CRASH, FAIL) and shows(vice, phase)
    ends_run = ends_run and phase not in AFTER_THE_RUN
    assert not any("Traceback" in line or "internal error" in line for line in err), err
    assert status == int(ends_run), err
    good = read(out / "good.nc")
    assert good.complete
    assert len(good.time) == 7
    assert (out / "comparison.csv").read_text().splitlines()[1:][1].startswith("good,")
    if ends_run:
        assert (out / "vicious.nc").read_bytes() == OLD
        assert len(err) == 1


def compare_with(folder, out, vice, phase, call):
    out.mkdir()
    (out / "vicious.nc").write_bytes(OLD)
    return call(
        folder, "compare", "two.ssp", "--swap", "b=vicious.fmu,good.fmu", "-o", out, "-q",
        vice=vice, phase=phase, after=STEPS.get(phase, 0),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("vice", "phase"),
    [
        ("segfault", "fmi2DoStep"),
        pytest.param("exit_0", "fmi2EnterInitializationMode", marks=pytest.mark.long),
    ],
)
def test_compare_is_never_ended_by_one_run(folder, tmp_path, vice, phase):
    outcome = compare_with(folder, tmp_path / "out", vice, phase, harness)
    check_compare(folder, tmp_path / "out", outcome, vice, phase)


@pytest.mark.long
@pytest.mark.parametrize("vice", NOT_ENDLESS)
@each("phase", PHASES)
def test_every_vice_in_every_phase_of_compare(folder, tmp_path, vice, phase):
    outcome = compare_with(folder, tmp_path / phase, vice, phase, harness)
    check_compare(folder, tmp_path / phase, outcome, vice, phase)


# ---- patience


def test_patience_ends_a_run_and_retains_its_rows(folder, tmp_path):
    status, out, err = in_process(
        folder, "run", "two.ssp", "-o", tmp_path / "x.nc", "-q", "--patience", 1,
        vice="endless_sleep", phase="fmi2DoStep", after=STEPS["fmi2DoStep"],
    )  # fmt: skip
    assert (status, out, len(err)) == (1, [], 1)
    assert err[0].startswith(
        "harness: b: fmi2DoStep has not returned for 1 s (at t = 2 s); 3 recorded"
    )
    assert len(read(tmp_path / "x.partial.nc").time) == 3


def test_patience_ends_one_run_of_a_comparison(folder, tmp_path):
    status, _, err = in_process(
        folder, "compare", "two.ssp", "--swap", "b=vicious.fmu,good.fmu", "-o", tmp_path / "out",
        "-q", "--patience", 1, "--no-figures",
        vice="endless_loop", phase="fmi2ExitInitializationMode",
    )  # fmt: skip
    assert status == 1
    assert [line for line in err if "note:" not in line] == [
        "harness: vicious: b: fmi2ExitInitializationMode has not returned for 1 s (at t = 0 s)"
    ]
    assert read(tmp_path / "out" / "good.nc").complete


# ---- campaigns

CAMPAIGN = """
system = "two.ssp"
patience = 2.0
[factors]
"swap.b" = {list = ["good.fmu", "vicious.fmu", "good.fmu"]}
[metrics]
end = "last(b.y)"
"""


def campaign_with(folder, vice, phase, workers=0):
    """Three runs, one of them with the vice; status and message of each, the ends of b.y."""
    from harness import campaign

    out = folder / "runs.zarr"
    shutil.rmtree(out, ignore_errors=True)
    (folder / "c.toml").write_text(CAMPAIGN)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment(vice, phase, STEPS.get(phase, 0)).items():
            patch.setenv(name, value)
        store = campaign(folder / "c.toml", out, workers=workers).store
    return store.array("status").tolist(), store.array("message").tolist(), store.array("end")


def check_campaign(folder, vice, phase, workers=0):
    status, message, end = campaign_with(folder, vice, phase, workers)
    kind = VICES[vice].kind
    ends_run = kind != QUIET and shows(vice, phase) and phase not in AFTER_THE_RUN
    assert status == [1, 2 if ends_run else 1, 1], message
    assert end[[0, 2]].tolist() == [6.0, 6.0]
    if ends_run:
        assert message[1].startswith("b: ")
    if ends_run and kind == CRASH and phase != "load":
        assert phase in message[1]
    if ends_run and phase == "fmi2DoStep":
        assert end[1] == 2.0
    return message[1]


@pytest.mark.parametrize(
    ("vice", "phase"),
    [
        ("segfault", "fmi2DoStep"),
        ("exit_0", "fmi2EnterInitializationMode"),
        ("kill_group", "fmi2GetReal"),
        ("fatal", "fmi2DoStep"),
        ("double_free", "fmi2FreeInstance"),
        ("chdir", "fmi2Instantiate"),
    ],
)
def test_a_fault_costs_one_run_of_a_campaign(folder, monkeypatch, vice, phase):
    monkeypatch.chdir(folder)
    check_campaign(folder, vice, phase)


@pytest.mark.parametrize(
    "phase", ["fmi2DoStep", pytest.param("fmi2ExitInitializationMode", marks=pytest.mark.long)]
)
def test_an_endless_loop_costs_one_run_of_a_campaign(folder, monkeypatch, phase):
    monkeypatch.chdir(folder)
    message = check_campaign(folder, "endless_loop", phase)
    assert f"b: {phase} has not returned for 2 s" in message


def test_workers_outlive_the_vices_of_a_run(folder, monkeypatch):
    """If a worker were lost instead, no message could name the call."""
    monkeypatch.chdir(folder)
    message = check_campaign(folder, "segfault", "fmi2DoStep", workers=2)
    assert message == ("b: fmi2DoStep crashed (SIGSEGV, segmentation fault) (at t = 2 s)")


@pytest.mark.long
@pytest.mark.parametrize("vice", NOT_ENDLESS)
@each("phase", PHASES)
def test_every_vice_in_every_phase_of_a_campaign(folder, monkeypatch, vice, phase):
    monkeypatch.chdir(folder)
    check_campaign(folder, vice, phase)


# ---- one FMU alone

LINEARIZE = ("linearize", "vicious.fmu", "-o", "model.npz")
EXPORT = ("export", "two.ssp", "copy.ssp")
CHECK = ("check", "two.ssp")
OTHERS = ("chdir", "kill_group", "error")


def check_command(folder, outcome, file):
    status, _, err = outcome
    assert not any("Traceback" in line or "internal error" in line for line in err), err
    assert status in (0, 1), err
    assert len(err) <= 1
    if file is not None:
        assert ((folder / file).read_bytes() == OLD) == (status == 1)


def test_linearize_names_the_call_that_has_crashed(folder):
    (folder / "model.npz").write_bytes(OLD)
    outcome = harness(folder, *LINEARIZE, vice="segfault", phase="fmi2DoStep")
    call = "fmi2DoStep, or the reading after it,"
    line = f"harness: vicious: {call} crashed (SIGSEGV, segmentation fault)"
    assert outcome == (1, [], [line])
    check_command(folder, outcome, "model.npz")


@pytest.mark.parametrize(
    ("command", "file"), [(LINEARIZE, "model.npz"), (EXPORT, "copy.ssp"), (CHECK, None)]
)
@pytest.mark.parametrize(
    "vice", ["exit_0", "noise", *(pytest.param(v, marks=pytest.mark.long) for v in OTHERS)]
)
def test_the_other_commands_survive_too(folder, command, file, vice):
    for phase in ("load", "fmi2ExitInitializationMode", "fmi2FreeInstance"):
        if file:
            (folder / file).write_bytes(OLD)
        check_command(folder, in_process(folder, *command, vice=vice, phase=phase), file)


@pytest.mark.long
@pytest.mark.parametrize("vice", NOT_ENDLESS)
@each("phase", PHASES)
def test_every_vice_in_every_phase_of_linearize_and_export(folder, vice, phase):
    for command, file in ((LINEARIZE, "model.npz"), (EXPORT, "copy.ssp")):
        (folder / file).write_bytes(OLD)
        check_command(folder, in_process(folder, *command, vice=vice, phase=phase), file)


# ---- what only a run in a process of its own can do


def test_counters_that_third_party_code_has_written_over_do_no_harm(folder, monkeypatch):
    """Shared memory is open to the child."""
    from harness import run
    from harness.errors import RunError
    from harness.master import isolated

    crash = isolated._run

    def scribble(send, *order):
        def begun(kind, content):
            if kind == isolated.BEGUN:
                send(kind, content)

        crash(begun, *order)
        order[-1].recorder.progress[:] = 2**62
        os.abort()

    monkeypatch.setattr(isolated, "_run", scribble)
    assert run(folder / "two.ssp").complete  # all rows are there, as far as can be seen

    def nonsense(send, *order):
        send(isolated.BEGUN, [("b", "fmi2DoStep")])
        order[-1].recorder.progress[:] = -(2**62)
        os.abort()

    monkeypatch.setattr(isolated, "_run", nonsense)
    with pytest.raises(RunError, match="crashed") as caught:
        run(folder / "two.ssp")
    assert len(caught.value.partial.time) == 1


def test_the_isolated_run_has_the_bits_of_the_one_in_process(folder):
    assert in_process(folder, "run", "two.ssp", "-o", "apart.csv")[0] == 0
    assert in_process(folder, "run", "two.ssp", "-o", "here.csv", "--in-process")[0] == 0
    assert (folder / "apart.csv").read_bytes() == (folder / "here.csv").read_bytes()


def test_a_chdir_inside_an_fmu_does_not_move_the_results(folder):
    """Not even in process."""
    for name in ("apart.csv", "here.csv"):
        (folder / name).unlink(missing_ok=True)
        further = ("--in-process",) if name == "here.csv" else ()
        status, _, _ = in_process(
            folder, "run", "two.ssp", "-o", name, *further, vice="chdir", phase="fmi2DoStep"
        )
        assert status == 0
        assert read(folder / name).complete


def test_our_own_fmus_stay_in_this_process(monkeypatch):
    from harness import run
    from harness.master import isolated

    monkeypatch.setattr(isolated, "_Run", None)
    assert run("sync_approach", stop=1.0).complete


@pytest.mark.parametrize("method", [True, False], ids=["fork", "spawn"])
def test_children_are_made_either_way(folder, monkeypatch, method):
    from harness import run

    monkeypatch.setattr(child, "FORK", method)
    assert run(folder / "two.ssp")["b.y"].tolist() == list(np.arange(7.0))
    assert Path.cwd() != folder


def third_party_copy(system, path):
    """The system with the same FMUs packed anew, so that they are not ours any more."""
    with zipfile.ZipFile(system) as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name.endswith(".fmu"):
                packed = io.BytesIO()
                with zipfile.ZipFile(io.BytesIO(data)) as fmu, zipfile.ZipFile(packed, "w") as to:
                    for entry in fmu.namelist():
                        to.writestr(entry, fmu.read(entry))
                data = packed.getvalue()
            new.writestr(name, data)


@pytest.mark.parametrize("stop", [60, pytest.param(1800, marks=pytest.mark.long)])
def test_a_whole_isolated_run_has_the_bits_of_one_in_process(tmp_path, stop):
    """Macro steps of five FMUs, from the command to the file."""
    copy = tmp_path / "sync_approach.ssp"
    third_party_copy(paths.systems()["sync_approach"], copy)
    for option in ((), ("--in-process",)):
        file = tmp_path / f"x{len(option)}.nc"
        status, _, err = harness(Path.cwd(), "run", copy, "-q", "-o", file, "--stop", stop, *option)
        assert (status, err) == (0, [])
    assert np.array_equal(read(tmp_path / "x0.nc").values, read(tmp_path / "x1.nc").values)
