# SPDX-License-Identifier: BSD-2-Clause
"""`harness run --watch`: what it shows on a terminal and elsewhere; the run stays the same."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from harness import read, run
from harness.cli import watch
from harness.cli.app import main
from harness.figures.choice import figure_of
from harness.figures.plots import paint
from harness.files import paths
from harness.master.simulation import Simulation
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.system.interface import read_interface
from ssp.shared.relative_motion import attitude_error, position_error, range_

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def looked(system, done, **changes):
    """Return the values of the watcher after so many macro steps, and the whole run."""
    with load(system) as found, Simulation(found, **changes) as simulation:
        simulation.advance(done)
        look = dict(watch.Watcher(simulation).lines(done))
        simulation.advance()
        return look, simulation.result()


def test_it_shows_the_errors_of_the_row_before_last_as_the_result_has_them():
    """The reference of the last row is in the row after it, which does not exist yet."""
    values, result = looked("sync_approach", 500, stop=100.0)
    assert values["time"] == "50 of 100 s"
    assert values["range"] == f"{range_(result)[500]:.4g} m"
    assert values["position error"] == f"{position_error(result)[499]:.4g} m"
    assert values["attitude error"] == f"{np.degrees(attitude_error(result)[499]):.4g} deg"
    assert values["attitude"] == "frozen until 1200 s"


def test_modes_have_the_names_of_their_description():
    look, result = looked("relay_approach", 20, stop=10.0)
    names = ("coast", "align", "burn")
    assert look["mode"] == names[int(result["guidance.mode"][20])]


LISTED = re.compile(r"\b0\W+[A-Za-z].*[,;] 1\W+[A-Za-z]")
"""A description that lists what 0 and 1 mean, in any grammar."""


def test_every_mode_of_every_fmu_has_names_by_number():
    found = {}
    for component, path in paths.fmus().items():
        for name, variable in read_interface(path).variables.items():
            if variable.causality != "parameter" and LISTED.search(variable.description):
                found[f"{component}.{name}"] = variable.modes.split("|")
    assert all(map(any, found.values())), [name for name, names in found.items() if not any(names)]
    phases = found["mission_manager.phase"]
    assert len(phases) == 15
    assert [phases[k] for k in (1, 3, 6)] == ["hold 1", "hold 2", "hold 3"]
    assert [phases[k] for k in (4, 11)] == ["fly-around", "back-off"]
    assert found["docking_mechanism.phase"][2] == "soft capture"
    assert found["pursuit_guidance.mode"] == ["coast", "align", "burn"]
    assert len(found) >= 15


def test_names_of_modes_survive_every_format(tmp_path):
    result = run("relay_approach", stop=1.0)
    assert result.mode_names("guidance.mode") == ("coast", "align", "burn")
    assert result.mode("guidance.mode", 2.0) == "burn"
    assert result.mode("guidance.mode", 7.0) == "7"
    assert not result.mode_names("guidance.range")
    for ending in ("nc", "mat", "csv", "parquet"):
        again = read(result.save(tmp_path / f"r.{ending}"))
        assert again.modes == result.modes, ending


def test_the_axis_of_a_mode_shows_its_names():
    result = run("relay_approach", stop=1.0)
    axes = paint(figure_of(result, ["guidance.mode"]), result).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["coast", "align", "burn"]


def test_the_latch_of_the_mission_has_its_whole_name():
    result = run("servicing_mission", stop=1.0)
    values = result.values.copy()
    values[:, result.columns.index("mechanism.phase")] = 2
    values[:, result.columns.index("manager.phase")] = 3
    last = replace(result, values=values)
    shown = {each.name: each.text(last) for each in watch.watched_metrics(last)}
    assert (shown["phase"], shown["latch"]) == ("hold 2", "soft capture")


def test_a_system_without_watched_metrics_shows_its_first_variables(make):
    with Simulation(make({"first": "counter", "second": "gain"}, ["first.n > second.u"])) as run_:
        run_.advance(3)
        look = dict(watch.Watcher(run_).lines(3)[2:])
        result = run_.result()
    assert list(look) == list(result.columns[: watch.OTHERS])
    numbers = [float(text.split()[0]) for text in look.values()]
    assert numbers == result.values[-1][: watch.OTHERS].tolist()
    assert look["first.n"] == "3"


def test_without_a_terminal_it_is_plain_lines_and_the_same_bits(tmp_path, capsys):
    file = tmp_path / "x.nc"
    assert main(["run", "sync_approach", "--stop", "60", "--watch", "-o", str(file)]) == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    *lines, summary = out.splitlines()[: out.count("sync_approach ") + 1]
    assert re.match(r"sync_approach +0 %: time 0\.1 of 60 s, real time x .*, range 20", lines[0])
    assert lines[-1].startswith("sync_approach 100 %: time 60 of 60 s")
    assert summary.startswith("sync_approach: 60 s in ")
    assert read(file).values.tobytes() == run("sync_approach", stop=60.0).values.tobytes()


def test_an_fmu_that_is_not_ours_is_watched_from_outside(make, tmp_path, capsys):
    write_ssp(make({"first": "counter"}, stop=200.0), tmp_path / "x.ssp")
    assert main(["run", str(tmp_path / "x.ssp"), "--watch", "-o", str(tmp_path / "x.csv")]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^test 100 %: time 200 of 200 s.*first\.n \d+", out, re.MULTILINE)


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals of POSIX")
def test_on_a_terminal_of_70_columns_it_is_a_table_that_is_renewed(tmp_path):
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 70, 0, 0))
    command = ["run", "sync_approach", "--stop", "60", "--watch", "-o", str(tmp_path / "x.nc")]
    process = subprocess.Popen(
        [sys.executable, "-m", "harness", *command],
        stdout=theirs,
        stderr=theirs,
        env=os.environ | {"TERM": "xterm", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    os.close(theirs)
    text = _all_of(ours)
    assert process.wait() == 0
    assert "\x1b[?25h" in text.rpartition("\x1b[?25l")[2]  # the cursor is back
    plain = [line.rstrip() for line in ESCAPES.sub("", text).replace("\r", "\n").split("\n")]
    assert {"time            60 of 60 s", "attitude        frozen until 1200 s"} <= set(plain)
    after = ("sync_approach: 60 s in", "requirement")
    table = [line for line in plain if not line.startswith(after)]
    assert max(map(len, table)) <= 70


def _all_of(terminal):
    """Return the text of a terminal until its last writer has closed it."""
    parts = []
    while True:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # the other end is closed
            part = b""
        if not part:
            os.close(terminal)
            return b"".join(parts).decode()
        parts.append(part)
