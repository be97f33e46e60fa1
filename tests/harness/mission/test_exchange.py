# SPDX-License-Identifier: BSD-2-Clause
"""The field's files: what others read of our results, and what we take from theirs."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import erfa
import numpy as np
import pytest
import xarray
from astropy import units
from astropy.coordinates import GCRS, TEME, CartesianDifferential, CartesianRepresentation
from astropy.time import Time
from astropy.utils import iers
from oem import OrbitEphemerisMessage
from scipy.spatial.transform import Rotation
from sgp4.api import Satrec

from harness import read, run
from harness.cli import main
from harness.errors import HarnessError, ResultsError, UsageError
from harness.master.changes import apply
from harness.mission.exchange import convert, start_values
from harness.report.run import notes
from harness.results.requirements import log_inconsistencies
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.instants import epoch_of
from ssp.shared.conventions import BODIES
from ssp.shared.exchange import czml
from ssp.shared.exchange.bodies import AU, EARTH, SUN, days_since_j2000, shadow, sun_direction
from ssp.shared.exchange.ccsds import write_oem
from ssp.shared.exchange.czml import ROWS, earth
from ssp.shared.exchange.sources import source_of
from tests.close import close
from tests.each import each

EPOCH = "2026-03-01T06:00:00"
ISS = (
    "1 25544U 98067A   20194.88612269 -.00002218  00000-0 -31515-4 0  9992\n"
    "2 25544  51.6461 221.2784 0001413  89.1723 280.4612 15.49507896236008\n"
)


def by_astropy(moment):
    """State of the elements by SGP4 and astropy alone, GCRS [m, m/s]."""
    error, r, v = Satrec.twoline2rv(*ISS.splitlines()).sgp4(moment.jd1, moment.jd2)
    assert error == 0
    velocity = CartesianDifferential(np.array(v) * units.km / units.s)
    state = CartesianRepresentation(np.array(r) * units.km, differentials=velocity)
    with iers.conf.set_temp("auto_download", False):
        found = TEME(state, obstime=moment).transform_to(GCRS(obstime=moment)).cartesian
    return found.xyz.to_value("m"), found.differentials["s"].d_xyz.to_value("m/s")


@pytest.fixture(scope="module")
def result():
    return run("sync_approach", set={"servicer.t_att": 0}, stop=20.0, params="robust")


@pytest.fixture
def out(result, tmp_path):
    return result.save(tmp_path / "out.nc")


# ---- whole results


@pytest.mark.parametrize("ending", [".nc", ".csv"])
def test_every_bit_comes_back_from_every_file(result, tmp_path, ending):
    back = read(result.save(tmp_path / f"out{ending}"))
    assert set(back.columns) == set(result.columns)
    assert back.time.tobytes() == result.time.tobytes()
    for name in result.vectors:
        assert back[name].tobytes() == result[name].tobytes()
        assert (back.unit(name), back.description(name)) == (
            result.unit(name),
            result.description(name),
        )
    for name in result.parameters.vectors:
        assert back.parameter(name).tolist() == result.parameter(name).tolist()
        assert back.parameters.unit(name) == result.parameters.unit(name)
    assert back.provenance == result.provenance
    assert (back.system, back.complete, back.message) == ("sync_approach", True, "")


@pytest.mark.parametrize("ending", [".nc", ".csv"])
def test_odd_names_and_one_row_come_back_from_every_file(tmp_path, ending):
    names = ("a.b.c", "a.b_c", "time.x", "a.v[0]", "a.v[1]", "a.lone[2]", "a.one[1]")
    odd = Result("x", np.zeros(1), names, ("m",) * 7, np.arange(7.0)[None], names)
    back = read(odd.save(tmp_path / f"odd{ending}"))
    assert {name: back[name].tolist() for name in names} == {
        name: [float(i)] for i, name in enumerate(names)
    }
    assert back["a.v"].tolist() == [[3.0, 4.0]]


def test_histories_of_a_nc_are_compressed_and_the_size_is_reported(tmp_path, capsys):
    out = tmp_path / "out.nc"
    assert main(["run", "sync_approach", "--stop", "300", "-o", str(out)]) == 0
    assert f"rows in {out} ({out.stat().st_size / 1e6:.1f} MB)" in capsys.readouterr().out
    back = read(out)
    assert out.stat().st_size < 0.7 * back.values.nbytes


# ---- ephemerides


def test_another_reader_finds_every_digit_of_an_oem(result, out, tmp_path):
    for body, letter in (("servicer", "S"), ("target", "T")):
        path = convert(out, tmp_path / f"{body}.oem", body, EPOCH)
        message = OrbitEphemerisMessage.open(str(path))
        meta = message.segments[0].metadata
        assert (meta["OBJECT_NAME"], meta["REF_FRAME"]) == (body.upper(), "EME2000")
        assert (meta["CENTER_NAME"], meta["TIME_SYSTEM"]) == ("EARTH", "UTC")
        states = message.states
        position = np.array([state.position for state in states])
        velocity = np.array([state.velocity for state in states])
        assert np.array_equal(position, result[f"{body}.r_{letter}N_N"] / 1000)
        assert np.array_equal(velocity, result[f"{body}.v_{letter}N_N"] / 1000)
        since = [(state.epoch - Time(EPOCH, scale="utc")).sec for state in states]
        assert since == pytest.approx(result.time.tolist(), abs=1e-6)


def test_an_aem_turns_inertial_into_body_axes(result, out, tmp_path):
    text = convert(out, tmp_path / "out.aem", "target", EPOCH).read_text(encoding="utf-8")
    head, _, body = text.partition("DATA_START\n")
    meta = dict(line.split(" = ") for line in head.splitlines() if " = " in line)
    assert meta["REF_FRAME_A"] == "EME2000"
    assert (meta["ATTITUDE_DIR"], meta["QUATERNION_TYPE"]) == ("A2B", "LAST")
    rows = [line.split() for line in body.partition("DATA_STOP")[0].splitlines()]
    assert rows[1][0] == "2026-03-01T06:00:00.100000"
    q = np.array([[float(x) for x in row[1:]] for row in rows])
    # frame A turned by q is frame B: an axis of B in components of A is q e q*
    axis_N = Rotation.from_quat(q).apply([1.0, 0.0, 0.0])
    w, x, y, z = result["target.q_TN"].T
    by_hand = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    assert np.allclose(axis_N, by_hand, atol=1e-15)
    # the attitude moves with its angular velocity
    omega = result["target.omega_TN_T"][10]
    step = Rotation.from_quat(q[10]).inv() * Rotation.from_quat(q[11])
    assert np.allclose(step.as_rotvec() / 0.1, omega, atol=1e-5)


def test_czml_holds_positions_and_earth_fixed_orientations(result, out, tmp_path):
    document, *packets = json.loads(convert(out, tmp_path / "out.czml", None, EPOCH).read_text())
    assert document["version"] == "1.0"
    assert [packet["id"] for packet in packets] == ["servicer", "target"]
    position = np.reshape(packets[0]["position"]["cartesian"], (-1, 4))
    assert packets[0]["position"]["referenceFrame"] == "INERTIAL"
    assert np.array_equal(position[:, 1:], result["servicer.r_SN_N"])
    turned = np.reshape(packets[1]["orientation"]["unitQuaternion"], (-1, 5))
    assert np.array_equal(turned[:, 0], result.time)
    moments = np.datetime64(EPOCH, "ns") + np.array([0, 20_000_000_000], dtype="timedelta64[ns]")
    inertial = Rotation.from_quat(turned[[0, -1], 1:]).as_matrix()
    back = np.transpose(earth(moments), (0, 2, 1)) @ inertial
    expected = Rotation.from_quat(result["target.q_TN"][[0, -1]][:, [1, 2, 3, 0]]).as_matrix()
    assert np.allclose(back, expected, atol=1e-12)
    assert (np.sum(turned[1:, 1:] * turned[:-1, 1:], axis=1) > 0).all()


def test_the_earth_turns_by_its_rotation_angle():
    """Beside precession and nutation, 0.4 deg in 2026: the Earth rotation angle of UT1 = UTC."""
    moment = np.datetime64("2026-03-01T06:00:00", "ns")
    x = earth(np.array([moment]))[0] @ np.array([1.0, 0, 0])
    days = float((moment - np.datetime64("2000-01-01T12:00:00", "ns")) / np.timedelta64(1, "D"))
    angle = 2 * np.pi * (0.7790572732640 + 1.00273781191135448 * days)
    assert np.angle(np.exp(1j * (np.arctan2(x[1], x[0]) + angle))) == pytest.approx(0, abs=0.01)


def test_long_runs_are_thinned_for_cesium(result, tmp_path):
    many = np.repeat(np.arange(len(result.time)), 60)
    long = replace(result, time=np.arange(len(many)) * 0.1, values=result.values[many])
    out = long.save(tmp_path / "long.nc")
    packets = json.loads(convert(out, tmp_path / "long.czml").read_text())
    assert ROWS / 2 < len(packets[1]["position"]["cartesian"]) / 4 <= ROWS


@pytest.mark.parametrize(
    ("body", "epoch", "ending", "problem"),
    [
        (
            "serviser",
            EPOCH,
            ".oem",
            r"--body serviser: sync_approach has no such body \(close: ",
        ),
        (None, "yesterday", ".oem", "--epoch yesterday: expected a date"),
        (None, EPOCH, ".xyz", "are converted to .*, not to '.xyz'"),
    ],
)
def test_a_wrong_conversion_is_reported_in_one_line(out, tmp_path, body, epoch, ending, problem):
    with pytest.raises(UsageError, match=problem):
        convert(out, tmp_path / f"x{ending}", body, epoch)


def test_bodies_that_do_not_circle_the_earth_have_no_ephemeris(tmp_path):
    out = run("relay_approach", stop=1.0).save(tmp_path / "out.nc")
    with pytest.raises(ResultsError, match="servicer: does not move in an orbit about the Earth"):
        convert(out, tmp_path / "x.oem")


def test_convert_prints_the_path_of_its_file(out, tmp_path, capsys):
    target = tmp_path / "x.oem"
    assert main(["convert", str(out), "-o", str(target), "--epoch", EPOCH]) == 0
    assert capsys.readouterr().out.startswith(f"{target} (")


# ---- start values


def test_an_ephemeris_of_a_run_starts_the_same_run(result, out, tmp_path):
    files = {b: convert(out, tmp_path / f"{b}.oem", b, EPOCH) for b in ("servicer", "target")}
    with load("sync_approach") as system:
        start = start_values(system, files)
    assert start.notes[0] == "t = 0 is 2026-03-01T06:00:00.000000 UTC"
    again = run("sync_approach", set={**start.values, "servicer.t_att": 0}, stop=20.0)
    for name in ("servicer.r_SN_N", "target.r_TN_N"):
        close(again[name][:2], result[name][:2], rel=1e-14)


def test_a_servicer_without_a_file_accompanies_the_target(result, out, tmp_path):
    """Started 10 s later, it is again at rho_0_H in the Hill frame of that time."""
    target = convert(out, tmp_path / "target.oem", "target", EPOCH)
    with load("sync_approach") as system:
        start = start_values(system, {"target": target}, "2026-03-01T06:00:10")
    r, v = (np.array(start.values[f"target.{name}"]) for name in ("r_0_N", "v_0_N"))
    close(r, result["target.r_TN_N"][100], rel=1e-14)
    again = run("sync_approach", set=start.values, stop=1.0)
    beside = again["servicer.r_SN_N"][0] - r
    along = np.cross(np.cross(r, v), r)
    assert np.linalg.norm(beside) == pytest.approx(20)
    assert beside @ along == pytest.approx(20 * np.linalg.norm(along))
    assert again["guidance.rho_H"][0] == pytest.approx([0, 20, 0], abs=1e-6)
    assert again["guidance.drho_H"][0] == pytest.approx([0, 0, 0], abs=1e-9)


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """File of two-line elements, and runs of one step with it, by the frame of the attitudes."""
    file = tmp_path_factory.mktemp("tle") / "iss.tle"
    file.write_text(f"ISS\n{ISS}", encoding="utf-8")
    with load("sync_approach_navigated") as system:
        starts = {
            f: start_values(system, {"target": file} | ({"attitude": f} if f else {}))
            for f in ("", "H", "N")
        }
    runs = {k: run("sync_approach_navigated", set=s.values, stop=0.1) for k, s in starts.items()}
    return starts, runs


def in_hill(result, attitude):
    """Attitude in the first row relative to the Hill frame of the target."""
    r, v = (np.array(result[f"target.{name}_TN_N"][0]) for name in ("r", "v"))
    normal = np.cross(r, v)
    axes = np.stack([r, np.cross(normal, r), normal])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return axes @ Rotation.from_quat(result[attitude][0][[1, 2, 3, 0]]).as_matrix()


def test_in_another_orbit_attitudes_are_the_same_relative_to_the_hill_frame(elsewhere):
    """Of both bodies and of the estimates of the filters; rates are the same in body axes."""
    starts, runs = elsewhere
    nominal = run("sync_approach_navigated", stop=0.1)
    for name in ("target.q_TN", "servicer.q_SN", "relative_filter.q_TN", "attitude_filter.q_SN"):
        here = in_hill(nominal, name)
        assert abs(in_hill(runs[""], name) - here).max() < 1e-8
        assert abs(in_hill(runs["N"], name) - here).max() > 0.1
    assert runs[""]["guidance.beta_t"][0] == pytest.approx(nominal["guidance.beta_t"][0], abs=1e-6)
    assert starts["H"].values == starts[""].values
    assert not [name for name in starts["N"].values if "sigma" in name]
    assert (runs[""]["target.omega_TN_T"][0] == nominal["target.omega_TN_T"][0]).all()


def test_a_frame_of_attitudes_that_is_none_is_rejected():
    with (
        load("sync_approach") as system,
        pytest.raises(UsageError, match=r"attitude=T: expected H \(Hill axes\) or N"),
    ):
        start_values(system, {"attitude": "T"})


def test_a_start_outside_the_corridor_is_a_note(elsewhere, caplog):
    """By elements, and by position and velocity."""
    starts, _ = elsewhere
    turned = {"target.sigma_TN_0": [0.3, 0.2, -0.25]}
    for values, name in ((turned, ""), (starts["N"].values, " (r_0_N)"), ({}, None)):
        caplog.clear()
        with load("sync_approach_navigated") as system:
            log_inconsistencies(apply(system, set=values))
        found = [r.getMessage().partition(":")[0] for r in caplog.records]
        assert found == ([] if name is None else [f"start inside the corridor{name}"])


def test_between_its_instants_an_ephemeris_is_interpolated(tmp_path):
    """Rows 10 s apart, wanted in the middle: to a millimetre of the run."""
    fine = run("sync_approach", stop=200.0)
    coarse = run("sync_approach", stop=200.0, every=100).save(tmp_path / "coarse.nc")
    oem = convert(coarse, tmp_path / "target.oem", "target", EPOCH)
    with load("sync_approach") as system:
        values = start_values(system, {"target": oem}, "2026-03-01T06:01:45").values
    right = fine["target.r_TN_N"][1050]
    assert np.linalg.norm(np.array(values["target.r_0_N"]) - right) < 1e-3


def test_two_line_elements_start_in_inertial_axes(tmp_path):
    """SGP4 by its own library, TEME to GCRS by astropy."""
    file = tmp_path / "iss.tle"
    file.write_text(f"ISS\n{ISS}", encoding="utf-8")
    with load("sync_approach") as system:
        start = start_values(system, {"target": file}, "2020-07-13T00:00:00")
    moment = Time("2020-07-13T00:00:00", scale="utc")
    position, rate = by_astropy(moment)
    assert np.linalg.norm(start.values["target.r_0_N"] - position) < 0.5
    assert np.linalg.norm(start.values["target.v_0_N"] - rate) < 1e-3


def test_their_own_epoch_is_the_start_unless_another_is_given(tmp_path):
    file = tmp_path / "iss.tle"
    file.write_text(ISS, encoding="utf-8")
    with load("sync_approach") as system:
        notes = start_values(system, {"target": file}).notes
    day = 0.88612269 * 86400
    assert notes[0].startswith(f"t = 0 is 2020-07-12T21:16:{day % 60:09.6f}"[:33])
    assert notes[1] == "target: iss.tle, SGP4, TEME turned into N"


@pytest.mark.parametrize(
    ("component", "text", "problem"),
    [
        ("targe", ISS, r"--start targe: sync_approach has no such component \(close: target"),
        ("guidance", ISS, r"--start guidance: it has no parameter"),
        ("target", "nonsense", "neither an OEM nor one set of two-line elements"),
        ("target", ISS.replace("9992", "9993"), "checksum"),
        ("target", ISS + ISS, "neither an OEM nor one set"),
        ("target", "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = x\n", "target: "),
        ("target", "<oem><broken", "target: "),
        ("target", '<!DOCTYPE a [<!ENTITY b "c">]><oem>&b;</oem>', "target: "),
    ],
)
def test_a_file_that_is_no_start_is_reported_in_one_line(tmp_path, component, text, problem):
    file = tmp_path / "start.txt"
    file.write_text(text, encoding="utf-8")
    with load("sync_approach") as system, pytest.raises(UsageError, match=problem) as rejected:
        start_values(system, {component: file})
    assert "\n" not in str(rejected.value)


def elements(line, first, text):
    """Two-line elements with other characters from a column on (counted from 1), and a right
    checksum.
    """
    lines = ISS.splitlines()
    body = lines[line - 1][: first - 1] + text + lines[line - 1][first - 1 + len(text) : 68]
    digits = sum(int(c) for c in body if c.isdigit()) + body.count("-")
    lines[line - 1] = f"{body}{digits % 10}"
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("line", "first", "text", "problem"),
    [
        (2, 3, "25545", "line 1 is of satellite 25544, line 2 of 25545"),
        (1, 21, "000.88612269", "epoch: 2020 has the days 1 to 366, not 0.886123"),
        (1, 21, "999.88612269", "epoch: 2020 has the days 1 to 366, not 999.886"),
        (1, 19, "19366.00000000", "epoch: 2019 has the days 1 to 365, not 366"),
        (1, 21, "19x", "epoch is not a year and day: '2019x.88612269'"),
        (2, 9, "180.1000", r"inclination \[deg\] must be 0 to 180, not 180.1"),
        (2, 9, " -1.0000", r"inclination \[deg\] must be 0 to 180, not -1"),
        (2, 9, "     nan", r"inclination \[deg\] is not a number: 'nan'"),
        (2, 18, "360.5000", "right ascension of the ascending node"),
        (2, 27, "00 1413", "eccentricity is not a number: '00 1413'"),
        (2, 35, "400.0000", "argument of perigee"),
        (2, 44, "-10.0000", "mean anomaly"),
        (2, 53, "00.00000000", "mean motion"),
        (2, 53, "99.00000000", "mean motion"),
    ],
)
def test_impossible_two_line_elements_are_rejected_with_the_reason(
    tmp_path, line, first, text, problem
):
    file = tmp_path / "iss.tle"
    file.write_text(elements(line, first, text), encoding="utf-8")
    with pytest.raises(UsageError, match=f"--start target: .*{problem}") as rejected:
        source_of("target", file)
    assert "\n" not in str(rejected.value)


def test_the_last_day_of_a_leap_year_is_one(tmp_path):
    file = tmp_path / "iss.tle"
    file.write_text(elements(1, 21, "366.99999999"), encoding="utf-8")
    with load("sync_approach") as system:
        notes = start_values(system, {"target": file}).notes
    assert notes[0].startswith("t = 0 is 2020-12-31T23:59:59.99")


BEHIND_UTC = {"GPS": 18.0, "TAI": 37.0, "TT": 69.184}
"""Lag of UTC behind other times since 2017 [s]."""


@pytest.mark.parametrize("system", [*BEHIND_UTC, "UT1"])
def test_an_ephemeris_in_another_time_starts_at_the_same_instant(result, out, tmp_path, system):
    """Every instant as the other time shows it: the states stay, and so does the start."""
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    head, _, rows = path.read_text(encoding="utf-8").partition("META_STOP\n")
    with iers.conf.set_temp("auto_download", False):
        ut1 = Time(EPOCH, scale="utc").ut1.delta_ut1_utc
    ahead = np.timedelta64(round(1e6 * BEHIND_UTC.get(system, float(ut1))), "us")

    def shown(text):
        return str(np.datetime64(text, "us") + ahead)

    head = re.sub(r"(?<=_TIME = )\S+", lambda m: shown(m[0]), head)
    rows = re.sub(r"^\S+", lambda m: shown(m[0]), rows, flags=re.MULTILINE)
    other = tmp_path / "other.oem"
    text = head.replace("TIME_SYSTEM = UTC", f"TIME_SYSTEM = {system}")
    other.write_text(f"{text}META_STOP\n{rows}", encoding="utf-8")
    with load("sync_approach") as model:
        own = start_values(model, {"target": other})
        assert own.notes[0].startswith("t = 0 is 2026-03-01T06:00:00.0")
        assert own.notes[1] == f"target: other.oem, EME2000 taken as N, times in {system}"
        for epoch, row in ((None, 0), ("2026-03-01T06:00:10", 100)):
            values = start_values(model, {"target": other}, epoch).values
            gap = np.array(values["target.r_0_N"]) - result["target.r_TN_N"][row]
            assert np.linalg.norm(gap) < (0.1 if system == "UT1" else 1e-6)  # 7.5 km/s, 10 us
        other.write_text(other.read_text().replace("= EME2000", "= TEME"))
        notes = start_values(model, {"target": other}).notes
        assert notes[1] == f"target: other.oem, TEME turned into N, times in {system}"


@pytest.mark.parametrize("system", ["TDB", "SCLK", "utc", "MET"])
def test_other_times_of_an_ephemeris_are_rejected_by_name(out, tmp_path, system):
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    text = path.read_text(encoding="utf-8").replace("= UTC", f"= {system}")
    path.write_text(text, encoding="utf-8")
    problem = f"its time system is {system}, expected GPS, TAI, TT, UT1, UTC"
    with pytest.raises(UsageError, match=problem):
        source_of("target", path)


ODD_EPOCHS = [
    "nat", "NaT", "now", "today", "", "2026", "2026-13-01", "2026-02-30", "2026-03-01T25:00",
    "2026-03-01T06:00:60", "2026-03-01T06:00:00+02:00", "1677-12-31", "2262-01-01", "2500-01-01",
    "0001-01-01", "9999-12-31", "10000-01-01", "-2026-03-01", "1" * 5000 + "-01-01", "2026-03-01\n",
    "2026-03-01T06:00:00.0000000001",
]  # fmt: skip


@each("epoch", ODD_EPOCHS)
def test_an_epoch_that_is_no_date_or_cannot_be_counted_is_rejected(epoch):
    with pytest.raises(UsageError, match=r"(?s)--epoch .*: expected a (date|year)"):
        epoch_of(epoch)


def test_an_epoch_is_rejected_wherever_it_is_given(out, tmp_path):
    file = tmp_path / "iss.tle"
    file.write_text(ISS, encoding="utf-8")
    cases = {"nat": ".oem", "": ".oem", "2500-01-01": ".aem", "1600-01-01": ".czml"}
    for epoch, ending in cases.items():
        with pytest.raises(UsageError, match=f"--epoch {epoch}: expected a (date|year)"):
            convert(out, tmp_path / f"x{ending}", None, epoch)
        assert not (tmp_path / f"x{ending}").exists()
        with load("sync_approach") as system, pytest.raises(UsageError, match=f"--epoch {epoch}"):
            start_values(system, {"target": file}, epoch)


@pytest.mark.parametrize("epoch", ["1678-01-01", "1700-06-01T00:00", "2261-12-31T23:00:00Z"])
def test_the_years_that_can_be_counted_come_out_as_they_were_given(result, out, tmp_path, epoch):
    rows = convert(out, tmp_path / "x.oem", None, epoch).read_text().splitlines()
    assert next(line for line in rows if line.startswith("START_TIME = ")).startswith(
        f"START_TIME = {epoch.removesuffix('Z')}"
    )
    begin = json.loads(convert(out, tmp_path / "x.czml", None, epoch).read_text())[1][
        "availability"
    ]
    assert begin.startswith(epoch[:10])
    moments = np.array([np.datetime64(epoch.removesuffix("Z"), "ns")])
    with pytest.warns(erfa.ErfaWarning):
        day = Time(epoch.removesuffix("Z"), scale="utc").jd - 2451545.0
    assert float(days_since_j2000(moments)[0]) == pytest.approx(day, abs=1e-6)


@pytest.mark.parametrize("last", [1e10, 1e300, np.inf, np.nan])
def test_times_that_lead_out_of_all_years_have_no_ephemeris(result, tmp_path, last):
    time = result.time.copy()
    time[-1] = last
    late = replace(result, time=time)
    with pytest.raises(ResultsError, match="times of the result, from 2026-03-01T06:00:00 on"):
        write_oem(BODIES, late, tmp_path / "x.oem", None, EPOCH)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "its centre is MARS, not the EARTH"),
        ("REF_FRAME = EME2000", "REF_FRAME = ITRF-97", "its axes are ITRF-97, expected only one"),
    ],
)
def test_axes_that_are_not_inertial_are_rejected(out, tmp_path, old, new, problem):
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with load("sync_approach") as system, pytest.raises(UsageError, match=problem):
        start_values(system, {"target": path})


def test_an_instant_outside_of_the_file_is_reported_in_one_line(out, tmp_path):
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    with load("sync_approach") as system, pytest.raises(UsageError, match="target") as rejected:
        start_values(system, {"target": path}, "2030-01-01T00:00:00")
    assert "\n" not in str(rejected.value)


def test_a_start_that_is_not_finite_is_reported_with_its_file(out, tmp_path, capsys):
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    head, _, rows = path.read_text(encoding="utf-8").partition("META_STOP\n")
    first, *rest = rows.splitlines()
    for number in ("nan", "inf", "1e400"):
        place = " ".join([first.split()[0], number, *first.split()[2:]])
        path.write_text("\n".join([f"{head}META_STOP", place, *rest]) + "\n", encoding="utf-8")
        start = ["--start", f"target={path}", "--stop", "1", "-o", str(tmp_path / "again.nc")]
        assert main(["run", "sync_approach", *start]) == 2
        line = f"harness: --start target: {path}: position or velocity at the epoch is not finite\n"
        assert capsys.readouterr().err == line


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
def test_a_start_without_end_is_not_read_to_its_end(monkeypatch, capsys):
    monkeypatch.setattr("ssp.shared.exchange.sources.LONGEST", 10**6)
    assert main(["run", "sync_approach", "--start", "target=/dev/zero"]) == 2
    reason = "/dev/zero: cannot be read (longer than the limit of 1000000 bytes)"
    assert capsys.readouterr().err == f"harness: --start target: {reason}\n"


def test_start_on_the_command_line(out, tmp_path, capsys):
    path = convert(out, tmp_path / "target.oem", "target", EPOCH)
    again = tmp_path / "again.nc"
    start = ["--start", f"target={path}", "--stop", "1", "-o", str(again)]
    assert main(["run", "sync_approach", *start, "--epoch", "2026-03-01T06:00:05"]) == 0
    assert "note: t = 0 is 2026-03-01T06:00:05.000000 UTC" in capsys.readouterr().out
    assert ("target.a", 0.0) in read(again).provenance.set
    assert read(again).provenance.epoch == "2026-03-01T06:00:05"


def test_a_missing_library_names_its_extra(monkeypatch, out, tmp_path):
    from harness import errors

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(errors, "import_module", missing)
    with pytest.raises(HarnessError, match=r"pyerfa: pip install 'servicing-fmus\[exchange\]'"):
        convert(out, tmp_path / "x.czml")
    assert erfa.__name__ == "erfa"


# ---- the epoch belongs to the run


def test_an_ephemeris_comes_back_with_its_dates_and_to_a_millimetre(out, tmp_path):
    """OEM -> --start -> OEM: the same instants, and at each of them the same place of the orbit."""
    first = convert(out, tmp_path / "first.oem", "target", "2026-03-01T06:00:00.123456")
    start = ["--start", f"target={first}", "--stop", "30", "-o", str(tmp_path / "again.nc")]
    assert main(["run", "sync_approach", *start]) == 0
    again = convert(tmp_path / "again.nc", tmp_path / "again.oem", "target")
    rows = [_ephemeris(path) for path in (first, again)]
    count = min(map(len, rows))
    assert count > 100
    for (then, was), (now, found) in zip(rows[0][:count], rows[1][:count], strict=True):
        assert now == then
        assert np.abs(1e3 * (found[:3] - was[:3])).max() < 1e-3
    assert "START_TIME = 2026-03-01T06:00:00.123456\n" in again.read_text()


def _ephemeris(path):
    lines = path.read_text().partition("META_STOP\n")[2].splitlines()
    rows = [line.split() for line in lines]
    return [(row[0], np.array(row[1:], dtype=float)) for row in rows]


def test_no_body_is_left_out_because_colours_run_out(out, tmp_path, monkeypatch):
    monkeypatch.setattr(czml, "COLOURS", ([1, 2, 3, 255],))
    _, *packets = json.loads(convert(out, tmp_path / "out.czml", None, EPOCH).read_text())
    colours = [each["point"]["color"]["rgba"] for each in packets]
    assert colours == [[1, 2, 3, 255]] * 2


def test_two_line_elements_give_the_run_their_date(tmp_path, monkeypatch):
    """The epoch of the elements, day 194.88612269 of 2020, counted by astropy."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "iss.tle").write_text(ISS)
    command = ["run", "sync_approach", "--start", "target=iss.tle", "--stop", "1", "-o", "run.nc"]
    assert main(command) == 0
    assert main(["convert", "run.nc", "-o", "target.oem", "--body", "target"]) == 0
    begin = re.search(r"START_TIME = (\S+)", (tmp_path / "target.oem").read_text())[1]
    day = Time("2020-01-01T00:00:00", scale="utc") + 193.88612269 * units.day
    assert abs((Time(begin, scale="utc") - day).to_value("s")) < 1e-5
    assert main(["convert", "run.nc", "-o", "all.czml"]) == 0
    packets = json.loads((tmp_path / "all.czml").read_text())
    assert packets[0]["clock"]["currentTime"].startswith(begin[:19])
    with xarray.open_dataset(tmp_path / "run.nc") as dataset:
        assert dataset["time"].values[0] == np.datetime64(begin, "ns")
        assert dataset["time"].values[-1] == np.datetime64(begin, "ns") + np.timedelta64(1, "s")
    assert xarray.Dataset.equals(read("run.nc").to_xarray(), xarray.open_dataset("run.nc"))


@pytest.mark.parametrize("epoch", ["2026-01-31T12:00:00", "2026-01-31T13:00:00+01:00"])
def test_a_system_has_its_epoch_in_its_file_and_retains_it(tmp_path, epoch):
    for quoted in (f'"{epoch}"', epoch) if "+" not in epoch else (epoch,):
        text = (
            f'extends = "sync_approach"\nname = "dated"\n[experiment]\nepoch = {quoted}\nstop = 1\n'
        )
        (tmp_path / "dated.toml").write_text(text)
        result = run(tmp_path / "dated.toml")
        assert result.provenance.epoch == "2026-01-31T12:00:00"
        result.save(tmp_path / "out.nc")
        oem = convert(tmp_path / "out.nc", tmp_path / "x.oem").read_text()
        assert "START_TIME = 2026-01-31T12:00:00.000000\n" in oem
        given = convert(tmp_path / "out.nc", tmp_path / "y.oem", None, EPOCH).read_text()
        assert f"START_TIME = {EPOCH}.000000\n" in given
    assert run(tmp_path / "dated.toml", epoch=EPOCH).provenance.epoch == EPOCH


def test_the_epoch_of_a_file_sets_the_sun_as_the_option_does(tmp_path):
    base, name = "sync_approach_navigated", "star_tracker.sun_N"
    text = f'extends = "{base}"\nname = "dated"\n[experiment]\nepoch = "{EPOCH}"\nstop = 1\n'
    (tmp_path / "dated.toml").write_text(text)
    sun = run(tmp_path / "dated.toml").parameter(name)
    with load(base) as system:
        assert np.array_equal(sun, start_values(system, {}, EPOCH).values[name])
    assert not np.allclose(sun, run(base, stop=1).parameter(name))


def test_an_epoch_that_is_no_date_is_a_problem_of_the_system(tmp_path):
    text = 'extends = "sync_approach"\nname = "dated"\n[experiment]\nepoch = "soon"\n'
    (tmp_path / "dated.toml").write_text(text)
    with pytest.raises(HarnessError, match=r"experiment\.epoch: expected a date .*, not 'soon'"):
        run(tmp_path / "dated.toml")
    with pytest.raises(UsageError, match="--epoch soon: expected a date"):
        run("sync_approach", epoch="soon", stop=0.1)


def test_the_sun_is_where_the_almanac_has_it():
    """Low-precision formula of the Astronomical Almanac (0.01 deg), mean equinox of date, taken
    back to J2000 by the precession in longitude of 1.3970 deg per century.
    """
    times = np.array(["2000-03-20T07:35", "2026-06-21T08:24", "2026-11-22T19:00"], "datetime64[ns]")
    n = days_since_j2000(times)
    longitude, anomaly = np.radians(280.460 + 0.9856474 * n), np.radians(357.528 + 0.9856003 * n)
    longitude += np.radians(1.915) * np.sin(anomaly) + np.radians(0.020) * np.sin(2 * anomaly)
    longitude -= np.radians(1.3970) * n / 36525
    tilt = np.radians(23.4393)
    required = np.stack(
        [np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)], -1
    )
    off = np.degrees(np.arccos(np.sum(required * sun_direction(times), axis=1)))
    assert off.max() < 0.02


def test_the_sun_reaches_the_sensors(tmp_path, capsys):
    command = ["run", "sync_approach_navigated", "--stop", "0.1", "-o", str(tmp_path / "n.nc")]
    assert main([*command, "--epoch", EPOCH]) == 0
    result = read(tmp_path / "n.nc")
    required = sun_direction(np.array([EPOCH], "datetime64[ns]"))[0]
    for sensor in ("star_tracker", "pose_sensor"):
        assert result.parameter(f"{sensor}.sun_N").tolist() == required.tolist()
    assert "note: Sun at t = 0: " in capsys.readouterr().out
    away = ["--set", "star_tracker.sun_N=[0, 0, 1]"]
    assert main([*command, "--epoch", EPOCH, *away]) == 0
    assert read(tmp_path / "n.nc").parameter("star_tracker.sun_N").tolist() == [0, 0, 1]


def test_the_shadow_is_the_part_of_the_disc_behind_the_earth():
    """A disc of 400 000 points behind a sphere, from umbra through penumbra to light."""
    towards, across = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    radius, angle = np.meshgrid(
        np.sqrt((np.arange(400) + 0.5) / 400), np.arange(1000) * 0.002 * np.pi
    )
    disc = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1).reshape(-1, 2)
    for height in (0.5e6, 6.28e6, 6.33e6, 6.36e6, 6.39e6, 6.5e6):
        r = -7.0e6 * towards + height * across
        centre = AU * towards - r
        up = np.cross(centre / np.linalg.norm(centre), [0, 0, 1.0])
        points = centre + SUN * (disc[:, :1] * up + disc[:, 1:] * np.array([0, 0, 1.0]))
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        along = -(rays @ r)
        hidden = (along > 0) & (np.linalg.norm(r + along[:, None] * rays, axis=1) < EARTH)
        found = float(shadow(r[None], towards[None])[0])
        assert abs(found - hidden.mean()) < 2e-3
    assert shadow(np.array([[7e6, 0, 0]]), towards[None])[0] == 0.0


def test_a_dated_result_states_when_it_is_in_the_shadow():
    """Against a shadow that is a cylinder; the penumbra takes some ten seconds."""
    result = run("sync_approach", stop=1800.0, every=10, epoch=EPOCH)
    r, to_sun = result["servicer.r_SN_N"], sun_direction(np.array([EPOCH], "datetime64[ns]"))[0]
    beside = np.linalg.norm(r - np.outer(r @ to_sun, to_sun), axis=1)
    dark = np.flatnonzero((r @ to_sun < 0) & (beside < EARTH))
    assert 0 == dark[0] < dark[-1] < 1790
    (line,) = [note for note in notes(result) if "shadow" in note]
    body, begin, end = re.fullmatch(
        r"(\w+) in the shadow of the Earth: (\S+) to (\S+) s", line
    ).groups()
    assert (body, float(begin)) == ("servicer", 0.0)
    assert 0 <= float(end) - result.time[dark[-1]] < 15
    undated = replace(result, provenance=replace(result.provenance, epoch=""))
    assert not [note for note in notes(undated) if "shadow" in note]
