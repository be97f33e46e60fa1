# SPDX-License-Identifier: BSD-2-Clause
"""`[start]` of a TOML: bodies that start from two-line elements or an ephemeris."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.time import Time

from harness import export, read, run
from harness.cli import main
from harness.errors import HarnessError, StructureError, UsageError
from harness.mission import library
from harness.mission.exchange import convert, start_values
from harness.report.run import notes
from harness.results.requirements import findings
from harness.results.verdict import Verdict
from harness.ssp.library import load
from ssp.shared.exchange import sources
from ssp.shared.exchange.start import State, elements
from tests.each import each
from tests.harness.mission.test_exchange import ISS, by_astropy

MU = 3.986004415e14
EXAMPLE = Path(__file__).parents[3] / "docs" / "own_mission.md"


@pytest.fixture(autouse=True)
def no_mission_stays(monkeypatch):
    """Forget the missions that other tests have named."""
    monkeypatch.setattr(library, "_named", {})


def mission(folder, start, more=""):
    folder.mkdir(exist_ok=True)
    (folder / "system.toml").write_text(f'extends = "sync_approach"\n[start]\n{start}\n{more}')
    return folder


@pytest.fixture
def inline(tmp_path):
    return mission(tmp_path / "mine", f'target = """\n{ISS}"""')


def test_elements_in_the_file_start_the_target_at_their_epoch(inline):
    result = run(inline, stop=0.1)
    moment = Time(result.provenance.epoch, scale="utc")
    day = Time("2020-01-01T00:00:00", scale="utc") + 193.88612269 * units.day
    assert abs((moment - day).to_value("s")) < 1e-5
    r, v = by_astropy(moment)
    assert np.linalg.norm(result["target.r_TN_N"][0] - r) < 0.5
    assert np.linalg.norm(result["target.v_TN_N"][0] - v) < 1e-3


def test_the_epoch_of_the_system_or_of_the_user_moves_the_body(tmp_path):
    """One epoch in the file, another one of the run: each time the elements are taken there."""
    dated = mission(
        tmp_path / "mine", f'target = """{ISS}"""', '[experiment]\nepoch = "2020-07-13T00:00:00"\n'
    )
    for given, epoch in ((None, "2020-07-13T00:00:00"), *(("2020-07-13T00:30:00",) * 2,)):
        result = run(dated, stop=0.1, epoch=given)
        assert result.provenance.epoch == epoch
        r, _ = by_astropy(Time(epoch, scale="utc"))
        assert np.linalg.norm(result["target.r_TN_N"][0] - r) < 0.5
        assert result["guidance.rho_H"][0] == pytest.approx([0, 20, 0], abs=1e-6)


def test_the_servicer_is_beside_the_target_wherever_that_is_put(inline):
    """Sets, --set and campaigns move the servicer in the Hill frame of the new orbit."""
    for place in ([0, 20, 0], [3, -18, 6]):
        result = run(inline, stop=0.1, set={"servicer.rho_0_H": place})
        assert result["guidance.rho_H"][0] == pytest.approx(place, abs=1e-6)
        assert result["guidance.drho_H"][0] == pytest.approx([0, 0, 0], abs=1e-9)


def test_it_is_the_start_of_the_command_line_to_the_bit(inline, tmp_path):
    (tmp_path / "iss.tle").write_text(ISS)
    with load("sync_approach") as system:
        start = start_values(system, {"target": tmp_path / "iss.tle"})
    other = run("sync_approach", set=start.values, epoch=start.epoch, stop=1.0)
    assert np.array_equal(run(inline, stop=1.0).values, other.values)


def test_a_path_counts_from_the_file_that_names_it(tmp_path, monkeypatch):
    """An ephemeris beside a system that another one extends, from a third folder."""
    oem = tmp_path / "base"
    oem.mkdir()
    simulated = run("sync_approach", stop=20.0, epoch="2026-03-01T06:00:00").save(tmp_path / "x.nc")
    convert(simulated, oem / "target.oem", "target")
    mission(oem, 'target = "target.oem"')
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "system.toml").write_text('extends = "base"\nname = "mine"\n')
    monkeypatch.chdir("/")
    result = run(tmp_path / "mine", stop=1.0)
    assert result.provenance.epoch == "2026-03-01T06:00:00"
    first = run("sync_approach", stop=1.0)
    assert np.abs(result["target.r_TN_N"] - first["target.r_TN_N"]).max() < 1e-6


def test_an_exported_system_holds_the_values_and_the_date(inline, tmp_path):
    ssp = export(inline, tmp_path / "mine.ssp")
    assert np.array_equal(run(ssp, stop=1.0).values, run(inline, stop=1.0).values)
    assert run(ssp, stop=0.1).provenance.epoch == "2020-07-12T21:16:01.000416"


def test_the_command_line_starts_another_body_beside_it(inline, tmp_path, capsys):
    (tmp_path / "iss.tle").write_text(ISS)
    out = tmp_path / "out.nc"
    start = ["--start", f"servicer={tmp_path / 'iss.tle'}", "--stop", "0.1", "-o", str(out)]
    assert main(["run", str(inline), *start]) == 0
    reported = capsys.readouterr().out
    assert "target: two-line elements, SGP4" in reported
    assert "servicer: iss.tle, SGP4" in reported


@pytest.mark.parametrize(
    ("start", "problem"),
    [
        ('tarqet = "x"', r"\[start\] tarqet: mine has no such component \(close: target\)"),
        ('target = "none.oem"', r"\[start\] target: .*none\.oem: cannot be read"),
        ('guidance = "x"', r"\[start\] guidance: it has no parameter"),
        ("target = 3", r"start\.target: must be a text, not 3"),
        (f'target = """{ISS.replace("9992", "9993")}"""', r"\[start\] target: .*checksum"),
    ],
)
def test_an_invalid_start_is_one_line_of_check_and_run(tmp_path, capsys, start, problem):
    folder = mission(tmp_path / "mine", start)
    with pytest.raises(StructureError, match=problem) as error:
        run(folder)
    assert len(error.value.problems) == 1
    assert main(["check", str(folder)]) == 1
    assert re.search(problem, capsys.readouterr().err)


def test_a_target_on_an_open_orbit_needs_a_file_for_its_servicer(tmp_path):
    """Twice the circular speed at 7000 km: e = 3."""
    lines = ["CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = X"]
    lines += ["META_START", "OBJECT_NAME = X", "OBJECT_ID = X", "CENTER_NAME = EARTH"]
    lines += ["REF_FRAME = EME2000", "TIME_SYSTEM = UTC"]
    dates = [f"2026-01-01T00:00:{k:02d}" for k in range(3)]
    lines += [f"START_TIME = {dates[0]}", f"STOP_TIME = {dates[-1]}", "META_STOP"]
    speed = 2 * np.sqrt(MU / 7e6) / 1000
    lines += [f"{date} 7000 {k * speed} 0 0 {speed} 0" for k, date in enumerate(dates)]
    (tmp_path / "open.oem").write_text("\n".join(lines) + "\n")
    with (
        load("sync_approach") as system,
        pytest.raises(UsageError, match=r"its orbit is open \(e = 3\), and servicer"),
    ):
        start_values(system, {"target": tmp_path / "open.oem"})


@each("e", [0.0, 1e-9, 1e-3, 0.7])
@each("inc", [0.0, 1e-9, 0.9, np.pi])
def test_elements_give_back_the_state_they_were_taken_of(e, inc):
    """Perifocal state turned by three rotations, of scipy, and back: to a micrometre."""
    from scipy.spatial.transform import Rotation

    a, argp, raan, nu = 7.2e6, 1.1, -2.0, 2.5

    def state(a, e, inc, argp, raan, nu):
        p = a * (1 - e**2)
        r = p / (1 + e * np.cos(nu)) * np.array([np.cos(nu), np.sin(nu), 0])
        v = np.sqrt(MU / p) * np.array([-np.sin(nu), e + np.cos(nu), 0])
        turn = Rotation.from_euler("ZXZ", [raan, inc, argp])
        return turn.apply(r), turn.apply(v)

    r, v = state(a, e, inc, argp, raan, nu)
    found = elements(State(r, v), MU)
    assert found[0] == pytest.approx(a, rel=1e-12)
    again = state(*found)
    assert np.linalg.norm(again[0] - r) < 1e-6
    assert np.linalg.norm(again[1] - v) < 1e-9


def test_a_navigated_system_starts_from_a_file(tmp_path):
    """The relative filter has an initial offset as the servicer has, but no orbit of its own; the
    orbit filter starts on an estimate of the servicer's.
    """
    (tmp_path / "iss.tle").write_text(ISS)
    with load("sync_approach_navigated") as system:
        start = start_values(system, {"target": tmp_path / "iss.tle"})
    assert {name.partition(".")[0] for name in start.values if name.endswith(".a")} == {
        "target",
        "servicer",
        "orbit_filter",
    }


# ---- the example of the documentation


@pytest.fixture
def example(tmp_path):
    """The mission that docs/own_mission.md shows."""
    blocks = re.findall(r"(?:^    .*\n)+", EXAMPLE.read_text(encoding="utf-8"), re.MULTILINE)
    (text,) = (re.sub("^    ", "", b, flags=re.MULTILINE) for b in blocks if "    [start]" in b)
    assert len(text.splitlines()) <= 25
    (tmp_path / "inspect").mkdir()
    (tmp_path / "inspect" / "system.toml").write_text(text)
    return tmp_path / "inspect"


def test_the_mission_of_the_page_is_sound_and_starts_in_its_orbit(example, capsys):
    assert main(["check", str(example), "--strict"]) == 0
    assert capsys.readouterr().out.startswith("inspect: fine")
    result = run(example, stop=0.1)
    r, _ = by_astropy(Time(result.provenance.epoch, scale="utc"))
    assert np.linalg.norm(result["target.r_TN_N"][0] - r) < 0.5
    assert np.linalg.norm((result["servicer.r_SN_N"] - result["target.r_TN_N"])[0]) == (
        pytest.approx(20)
    )


@pytest.mark.long
def test_the_mission_of_the_page_meets_its_requirements(example):
    assert {f.verdict for f in findings(run(example))} == {Verdict.MET}


def test_a_missing_library_is_named(tmp_path):
    """As with --start."""
    folder = mission(tmp_path / "mine", f'target = """{ISS}"""')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sources, "library", _gone)
        with pytest.raises(HarnessError, match="sgp4"):
            run(folder)


def _gone(name, extra):
    raise HarnessError(f"{name} is missing: pip install servicing-fmus[{extra}]")


OWN = """
from pathlib import Path

from harness.mission import Exchange, Mission, Start


def write(result, path, body, epoch):
    path.write_text(f"{result.system} {body} {epoch}")


def start(system, files, epoch, **changes):
    masses = {f"{c}.mass_0": float(Path(f).read_text()) for c, f in files.items()}
    return Start(masses, ("masses are weighed",), epoch or "2026-03-01T06:00:00")


MISSION = Mission(exchange=(Exchange({".mine": write}, start, lambda result: ["seen"]),))
"""


def test_a_mission_brings_files_of_its_own(tmp_path, capsys):
    folder, out = tmp_path / "weighed", tmp_path / "out.nc"
    folder.mkdir()
    (folder / "system.toml").write_text('extends = "sync_approach"\n')
    (folder / "mission.py").write_text(OWN)
    (tmp_path / "mass.txt").write_text("123")
    started = ["--start", f"servicer={tmp_path / 'mass.txt'}", "--stop", "0.1", "-o", str(out)]
    assert main(["run", str(folder), *started]) == 0
    assert "note: masses are weighed" in capsys.readouterr().out
    result = read(out)
    assert result.parameter("servicer.mass_0") == 123
    assert notes(result) == ["seen"]
    assert main(["convert", str(out), "-o", str(tmp_path / "x.mine")]) == 0
    assert (tmp_path / "x.mine").read_text() == "weighed None 2026-03-01T06:00:00"
    assert main(["convert", str(out), "-o", str(tmp_path / "x.oem")]) == 2
    assert "to .csv, .nc, .mine, not to '.oem'" in capsys.readouterr().err
