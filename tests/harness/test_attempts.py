# SPDX-License-Identifier: BSD-2-Clause
"""Attempts to make the harness end in an internal error, in silence or not at all: every one costs
a line, which `make test-long` prints.

A row of ATTEMPTS is a name, what is prepared in an empty folder, the command line, its exit status
and the beginning of what it reports. Files are in the folder under the names that the line uses:
out.nc is a run of sync_approach of one second, demo.ssp a small third-party system.
"""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import netCDF4
import numpy as np
import pytest

from harness import read, run
from harness.cli import main
from harness.ssp.build import system_of
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from tests.harness.demo import TOML
from tests.harness.mission.test_exchange import ISS, elements

pytestmark = pytest.mark.long

RUN = "run sync_approach --stop 1 -q -o again.nc"
EPOCH = "harness: --epoch {}: expected a "


def nothing(_: Path) -> None:
    pass


class Attempt(NamedTuple):
    """One attempt; states: beginning of the first line of standard error."""

    name: str
    command: str
    status: int
    states: str
    prepare: Callable[[Path], None] = nothing


def written(name: str, text: str) -> Callable[[Path], None]:
    """A file of that text."""
    return lambda folder: (folder / name).write_text(text, encoding="utf-8") and None


def required(text: str) -> Callable[[Path], None]:
    """theirs.ssp, which brings a requirement along."""

    def prepare(folder: Path) -> None:
        with load("sync_approach") as system:
            write_ssp(replace(system, requirements={"theirs": text}), folder / "theirs.ssp")

    return prepare


def attribute(name: str, value: object) -> Callable[[Path], None]:
    """out.nc with another attribute."""

    def prepare(folder: Path) -> None:
        with netCDF4.Dataset(folder / "out.nc", "a") as file:
            file.setncattr(name, value)

    return prepare


def values(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """out.nc with other numbers of a variable."""

    def prepare(folder: Path) -> None:
        with netCDF4.Dataset(folder / "out.nc", "a") as file:
            file[name][...] = change(file[name][...])

    return prepare


def bomb(folder: Path) -> None:
    """A few kB that unpack to 24 GB."""
    with netCDF4.Dataset(folder / "bomb.nc", "w") as file:
        file.createDimension("time", 3_000_000_000)
        file.createVariable("time", "f8", ("time",), zlib=True)


def parameter_twice(folder: Path) -> None:
    space = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    one = '<v:Parameter name="twice.k"><v:Real value="2"/></v:Parameter>'
    (folder / "twice.ssv").write_text(
        f'<v:ParameterSet xmlns:v="{space}" version="1.0" name="x"><v:Parameters>{one}{one}'
        "</v:Parameters></v:ParameterSet>"
    )


def ephemeris(system: str) -> Callable[[Path], None]:
    """target.oem in another time system."""

    def prepare(folder: Path) -> None:
        assert main(["convert", "out.nc", "-o", "target.oem", "--body", "target"]) == 0
        path = folder / "target.oem"
        path.write_text(path.read_text().replace("= UTC", f"= {system}"), encoding="utf-8")

    return prepare


UNREADABLE = "harness: out.nc: cannot be read ("
LONG_SUM = " + ".join(["guidance.range"] * 650) + " > 1 m"

ATTEMPTS = [
    *(
        Attempt(
            f"requirement {name}",
            f"{RUN} --require {shlex.quote(text)}",
            2,
            f"harness: --require {text[:9]}",
        )
        for name, text in {
            "sin(x, x)": "sin(guidance.range, guidance.range) > 0",
            "30 000 digits": "guidance.range > " + "1" * 30_000,
            "9 000 digits": "guidance.range > " + "1" * 9_000,
            "650 terms": LONG_SUM,
            "exponent of a unit": "guidance.range > 1 m" + "9" * 400,
            "number beyond doubles": "guidance.range > 1" + "0" * 320 + " m",
            "parentheses": "guidance.range > " + "(" * 3_000 + "1" + ")" * 3_000,
        }.items()
    ),
    Attempt(
        "rows that are no numbers",
        f"{RUN} --require 'not sqrt(-time) > 0'",
        1,
        "harness: requirement NOT MET: not sqrt(-time) > 0; not a number at 0.1 s",
    ),
    *(
        Attempt(
            f"strict run of a .ssp with {name}",
            "run theirs.ssp --stop 1 -q --strict -o again.nc",
            1,
            "harness: requirement not judged: theirs (",
            required(text),
        )
        for name, text in {"650 terms": LONG_SUM, "9 000 digits": "time > " + "1" * 9_000}.items()
    ),
    *(
        Attempt(
            f"epoch {epoch or 'empty'}",
            f"convert out.nc -o x.oem --epoch '{epoch}'",
            2,
            EPOCH.format(epoch),
        )
        for epoch in ("nat", "now", "", "1677-01-01", "2262-01-01", "9999-12-31", "2026-13-01")
    ),
    *(
        Attempt(
            f"two-line elements, {states}",
            f"{RUN} --start target=iss.tle",
            2,
            f"harness: --start target: iss.tle: {states}",
            written("iss.tle", elements(line, first, text)),
        )
        for line, first, text, states in (
            (2, 3, "25545", "line 1 is of satellite 25544, line 2 of 25545"),
            (1, 21, "000.88612269", "line 1, columns 19 to 32: epoch: 2020 has the days 1 to 366"),
            (1, 21, "999.88612269", "line 1, columns 19 to 32: epoch: 2020 has the days 1 to 366"),
            (2, 9, "180.1000", "line 2, columns 9 to 16: inclination [deg] must be 0 to 180"),
        )
    ),
    Attempt(
        "two satellites",
        f"{RUN} --start target=two.tle",
        2,
        "harness: --start target: two.tle: neither an OEM nor one set",
        written("two.tle", ISS * 2),
    ),
    Attempt(
        "ephemeris in SCLK",
        f"{RUN} --start target=target.oem",
        2,
        "harness: --start target: target.oem: its time system is SCLK",
        ephemeris("SCLK"),
    ),
    Attempt("ephemeris in GPS time", f"{RUN} --start target=target.oem", 0, "", ephemeris("GPS")),
    Attempt(
        "start without end",
        f"{RUN} --start target=/dev/zero",
        2,
        "harness: --start target: /dev/zero: cannot be read (longer than the limit",
    ),
    *(
        Attempt(
            f"{command.split()[0]} of a result with {name}", command, 1, UNREADABLE + states, change
        )
        for command in ("report out.nc", "convert out.nc -o x.csv", "run --like out.nc -q -o x.nc")
        for name, states, change in (
            ("swaps of lists", "swaps: ", attribute("provenance_swaps", "[[[1], 2, 3]]")),
            ("a step of text", "step: must be a finite number", attribute("provenance_step", "x")),
            ("NaN times", "row 0 has the time nan", values("time", lambda t: t * np.nan)),
            ("times backwards", "row 1 is earlier", values("time", lambda t: t[::-1])),
            ("a system 5", "system: expected a text", attribute("system", 5)),
        )
    ),
    Attempt(
        "forged time",
        "run --like out.nc -q -o x.nc",
        1,
        "",
        values("time", lambda t: t + 1e-9 * (t > 0.5)),
    ),
    Attempt(
        "forged parameter",
        "run --like out.nc -q -o x.nc",
        1,
        "",
        values("servicer.mass_0", lambda m: m + 1),
    ),
    Attempt("24 GB in some kB", "report bomb.nc", 1, "harness: bomb.nc: cannot be read (it", bomb),
    Attempt(
        "a .toml of 3 000 dots",
        "run demo.ssp -q --params deep.toml",
        1,
        "harness: deep.toml: not a readable TOML file (nested too deep)",
        written("deep.toml", ".".join(["a"] * 3000) + " = 1"),
    ),
    Attempt(
        "a campaign of 3 000 dots",
        "campaign deep.toml",
        1,
        "harness: deep.toml: not a readable TOML file (nested too deep)",
        written("deep.toml", ".".join(["a"] * 3000) + " = 1"),
    ),
    Attempt("a sample period of 1e308 s", f"{RUN} --set controller.sample_period=1e308", 0, ""),
    Attempt(
        "no clock",
        "processor adaptive_controller --on cortex-m7 --clock 0",
        2,
        "harness: --clock 0: expected a frequency above 0 [Hz]",
    ),
    Attempt(
        "clock nan",
        "processor adaptive_controller --on cortex-m7 --clock nan",
        2,
        "harness: --clock nan: expected a frequency above 0 [Hz]",
    ),
    Attempt(
        "a parameter twice", "run demo.ssp -q --params twice.ssv", 1, "harness: ", parameter_twice
    ),
    Attempt("rows that do not divide the run", f"{RUN} --every 3", 0, ""),
]


@pytest.fixture(scope="module")
def result():
    return run("sync_approach", stop=1.0)


@pytest.mark.parametrize("attempt", ATTEMPTS, ids=[attempt.name for attempt in ATTEMPTS])
def test_an_attempt_costs_a_line(attempt, result, fmus, tmp_path, capsys, record_property):
    result.save(tmp_path / "out.nc")
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    attempt.prepare(tmp_path)
    capsys.readouterr()
    status = main(shlex.split(attempt.command))
    out, err = capsys.readouterr()
    first = next(iter((err or out).splitlines()), "done")
    record_property("attempt", f"{attempt.name}: {first[:150]}")
    assert "internal error" not in err
    assert "Traceback" not in err
    assert (status, err[: len(attempt.states)]) == (attempt.status, attempt.states)
    assert err or out or attempt.status == 0
    if attempt.name.startswith("rows that do not"):
        assert read("again.nc").time[-1] == 1.0
    if attempt.name.startswith("forged"):
        assert out.startswith("the bits differ: ")
