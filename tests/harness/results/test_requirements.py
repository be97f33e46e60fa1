# SPDX-License-Identifier: BSD-2-Clause
"""Requirements: conditions with units, evaluated row by row, with the worst instant."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness import read, run
from harness.cli import main
from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.results.expressions import FUNCTIONS
from harness.results.requirements import Finding, finding, findings, margin
from harness.results.result import Result
from harness.results.verdict import Verdict
from harness.ssp.build import system_of
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.studies.check import check
from harness.system.units import SYMBOLS, convert, unit
from tests.close import close
from tests.each import each
from tests.harness.demo import TOML

ROWS = 11
MET, MISSED = Verdict.MET, Verdict.NOT_MET
IDLE, OPEN = Verdict.NOT_EXERCISED, Verdict.NOT_JUDGED


@pytest.fixture(scope="module")
def result():
    """x falls from 10 to 0 m and is 3 m at 7 s; v has its largest element, 4, at 2 s; angle: a
    ramp to 1 rad.
    """
    time = np.arange(ROWS, dtype=float)
    v = np.zeros((ROWS, 3))
    v[2] = 1, -2, 4
    columns = ("a.x", "a.v[1]", "a.v[2]", "a.v[3]", "a.angle", "a.on", "a.km")
    values = np.column_stack([10 - time, v, time / 10, time < 5, np.full(ROWS, 1e-3)])
    limits = ("a.limit", "a.late"), ("m", "s"), np.array([[2.0, 2.0]])
    parameters = Result("demo", time[:1], *limits)
    units = ("m", "m/s", "m/s", "m/s", "rad", "1", "km")
    return Result("demo", time, columns, units, values, parameters=parameters)


@each(
    ("text", "verdict", "value", "unit", "time"),
    [
        ("a.x >= 0", MET, 0.0, "m", 10),
        ("a.x > 0", MISSED, 0.0, "m", 10),
        ("a.x <= 900 cm", MISSED, 1000.0, "cm", 0),
        ("900 cm >= a.x", MISSED, 1000.0, "cm", 0),
        ("a.x <= 0.01 km", MET, 0.01, "km", 0),
        ("a.x > -1 m", MET, 0.0, "m", 10),
        ("a.v <= 3 m/s", MISSED, 4.0, "m/s", 2),
        ("a.v >= -3", MET, -2.0, "m/s", 2),
        ("norm(a.v) <= 300 m/min", MET, 60 * math.sqrt(21), "m/min", 2),
        ("max(a.v) == 4", MET, 4.0, "m/s", None),
        ("last(a.v) == 0", MET, 0.0, "m/s", None),
        ("a.v[2] >= -2", MET, -2.0, "m/s", 2),
        ("at(a.v, 2 s)[3] > 300 m/min", MISSED, 240.0, "m/min", None),
        ("a.angle < 57 deg", MISSED, math.degrees(1), "deg", 10),
        ("degrees(a.angle) < 58", MET, math.degrees(1), "deg", 10),
        ("time < 7 s or a.x <= 3 m", MET, 3.0, "m", 7),
        ("time < 0.1 min or a.x <= 3 m", MISSED, 4.0, "m", 6),
        ("a.x >= 1 and a.angle <= 2 rad", MISSED, 0.0, "m", 10),
        ("not a.x < 2", MISSED, 0.0, "m", 10),
        ("parameter(a.limit) <= 300 cm", MET, 200.0, "cm", None),
        ("a.x > parameter(a.limit)", MISSED, 0.0, "m", 10),
        ("time > 4 or a.on == 1", MET, 1.0, "1", 0),
        ("time < 1 h or a.x > 99", IDLE, None, "", None),
        ("time >= 5 s", MISSED, 0.0, "s", 0),
        ("time < 1 h", MET, 10 / 3600, "h", 10),
        ("time < parameter(a.late) or a.x < 9", MET, 8.0, "m", 2),
        ("time < 10 * parameter(a.late) or a.x > 99", IDLE, None, "", None),
        ("a.x >= 0 or time < 1 h", IDLE, None, "", None),
        ("not (time >= 1 h and a.x > 99)", IDLE, None, "", None),
        ("a.x >= 0 and (time < 1 h or a.x > 99)", IDLE, None, "", None),
        ("a.x >= 1 and (time < 1 h or a.x > 99)", MISSED, 0.0, "m", 10),
        ("time < 5 or (a.x >= 0 and (time < 1 h or a.x > 99))", IDLE, None, "", None),
        ("time < 5 or a.x >= 0 or (time > 1 h and a.x > 99)", MET, 0.0, "m", 10),
        ("a.x >= 0 or ((time < 1 h or a.x > 99) and a.x >= -1)", MET, 0.0, "m", 10),
        ("time < 1 h or norm(a.v) > 99", IDLE, None, "", None),
        ("time <= 10 or a.x > 99", IDLE, None, "", None),
        ("time < 10 or a.x > 99", MISSED, 0.0, "m", 10),
        ("settling_time(time, a.x, 2.5) <= 10 s", MET, 8.0, "s", None),
        ("settling_time(time, a.x, 250 cm) <= 10 s", MET, 8.0, "s", None),
        ("a.x * a.x <= 1e6 cm2", MET, 1e6, "cm2", 0),
        ("a.x + 1 m >= 100 cm", MET, 100.0, "cm", 10),
        ("a.km >= a.x", MISSED, 0.001, "km", 0),
        ("a.x <= a.km", MISSED, 10.0, "m", 0),
        ("a.x - a.km > 0 m", MISSED, -1.0, "m", 10),
        ("a.x / 1 s >= norm(a.v)", MET, 0.0, "m/s", 10),
        ("sqrt(a.x * a.x) >= a.km - 1 m", MET, 0.0, "m", 10),
        ("sin(a.angle) <= sin(58 deg)", MET, math.sin(1), "1", 10),
        ("percentile(a.x, 50) == 500 cm", MET, 500.0, "cm", None),
        ("implies(a.x <= 3, a.x <= 3 m)", MET, 3.0, "m", 7),
        ("implies(a.x <= 3, a.x < 300 cm)", MISSED, 300.0, "cm", 7),
        ("implies(a.x > 99, a.x > 99)", IDLE, None, "", None),
        ("a.x >= 0 and implies(a.x > 99, a.angle < 0)", IDLE, None, "", None),
        ("implies(time >= 5 s and a.x >= 4, a.x <= 5 m)", MET, 5.0, "m", 5),
        ("implies(a.x <= 3, implies(a.x > 99, a.angle < 0))", IDLE, None, "", None),
        ("not implies(a.x > 99, a.angle < 0)", MISSED, 10.0, "m", 0),
    ],
)
def test_a_condition_is_evaluated_with_its_worst_row(result, text, verdict, value, unit, time):
    found = finding(result, "name", text)
    assert (found.verdict, found.unit, found.time) == (verdict, unit, time), found
    assert found.value == (value if value is None else pytest.approx(value, rel=1e-12))


def test_the_premise_of_an_implication_does_not_enter_the_margin(result):
    assert margin(result, "implies(a.x <= 3, a.x <= 4 m)") == pytest.approx(1, abs=1e-12)
    assert finding(result, "name", "implies(a.on == 1, a.x <= 99 m)").margin_unit == "m"
    assert finding(result, "name", "implies(a.x > 99, a.on == 1)").margin is None


@each(
    ("text", "fails"),
    [
        ("a.x >= 0 m", False),
        ("a.x > 0 m", True),
        ("not a.x <= 0 m", True),
        ("a.x != 0 m", True),
        ("always(a.x > 0 m)", True),
        ("always(a.x >= 0 m)", False),
    ],
)
def test_at_its_limit_only_a_requirement_that_fails_has_a_negative_margin(text, fails, result):
    found = finding(result, "name", text)
    assert found.margin == pytest.approx(0, abs=1e-300)
    assert (found.margin < 0, found.verdict) == (fails, MISSED if fails else MET)


def test_an_implication_has_two_conditions(result):
    for text in ("implies(a.x > 1)", "implies(a.x > 1, a.x > 2, a.x > 3)"):
        assert "implies(x, y): expected 2 arguments" in finding(result, "name", text).reason


def test_a_requirement_is_read_once_for_all_runs(result, monkeypatch):
    def verdict():
        return finding(result, "", "a.x <= 10.25 m").verdict

    assert verdict() is MET
    monkeypatch.delattr("ast.parse")
    assert verdict() is MET


def test_the_same_text_is_evaluated_in_the_units_of_every_result(result):
    """A swapped FMU may have others."""
    longer = replace(result, units=("km", *result.units[1:]))
    plain = replace(result, units=("", *result.units[1:]))
    for _ in range(2):
        found = [finding(each, "", "a.x <= 900 cm") for each in (result, longer, plain)]
        assert [f.value for f in found] == [pytest.approx(1000), pytest.approx(1e6), None]
        assert [f.verdict for f in found] == [MISSED, MISSED, OPEN]


def test_a_value_that_is_no_number_does_not_meet_a_requirement(result):
    values = result.values.copy()
    values[4, 0] = np.nan
    found = finding(Result("demo", result.time, result.columns, result.units, values), "", "a.x<99")
    assert (found.verdict, found.time) == (MISSED, 4)
    assert math.isnan(found.value)


@each(
    ("text", "margin"),
    [
        ("a.x == a.x", 0.0),
        ("a.x <= a.x", 0.0),
        ("always(a.x >= a.x)", 0.0),
        ("a.x < a.x + 1", 0.0),
        ("a.x > -1", 1.0),
    ],
)
def test_a_met_requirement_has_no_failing_margin_where_values_are_infinite(result, text, margin):
    values = result.values.copy()
    values[3, 0] = math.inf
    found = finding(replace(result, values=values), "", text)
    met = text != "a.x < a.x + 1"
    assert found.margin == pytest.approx(margin, abs=1e-300)
    assert (found.verdict is MET, found.margin < 0) == (met, not met)


@each(
    ("text", "verdict", "margin"),
    [
        ("not a.v > 3", MISSED, -1.0),
        ("a.v > 3 or a.v < 3.5", MET, 1.0),
        ("not (a.x > 99 and sqrt(a.x - 11 m) > 0)", MET, 89.0),
        ("norm(a.v) < 3 or a.x > 2", MET, 3.0),
        ("a.v < 4.5 and a.x > -1", MET, 0.5),
    ],
)
def test_a_margin_has_the_sign_of_the_verdict_for_vectors_and_gaps(result, text, verdict, margin):
    found = finding(result, "", text)
    assert (found.verdict, found.margin) == (verdict, margin)


@pytest.fixture(scope="module")
def gap(result):
    """x is not a number at 4 s, angle is not at 6 s."""
    values = result.values.copy()
    values[4, 0] = values[6, 4] = np.nan
    return Result("demo", result.time, result.columns, result.units, values)


@each(
    ("text", "time"),
    [
        ("sqrt(-time) > 0", 1),
        ("not sqrt(-time) > 0", 1),
        ("sqrt(-time) >= 0", 1),
        ("a.x < 99", 4),
        ("not a.x > 99", 4),
        ("a.x != 99", 4),
        ("not a.x == 99", 4),
        ("99 > a.x", 4),
        ("a.x < 99 and a.angle < 99", 4),
        ("a.x < 99 or a.angle > 99", 4),
        ("time > 5 or a.x < 99", 4),
        ("not (a.x > 99 or time > 99)", 4),
        ("max(a.x) < 99", None),
        ("settling_time(time, a.x, 99) >= 0 and settling_time(time, a.x, 99) < 3", 0),
        ("settling_time(time, sqrt(-time), 1) == 0", None),
        ("a.v < 9 and a.angle < 9", 6),
        ("implies(a.x < 50, a.angle < 99)", 6),
        ("implies(a.angle < 99, a.x < 99)", 4),
    ],
)
def test_a_row_that_is_no_number_is_not_judged_by_the_others(gap, text, time):
    found = finding(gap, "name", text)
    if text.startswith("settling_time(time, a.x"):  # at the end it is inside again
        assert (found.verdict, found.value) == (MISSED, 5.0)
        return
    assert (found.verdict, found.time) == (MISSED, time), found
    assert math.isnan(found.value)
    place = "" if time is None else f" at {time} s"
    assert str(found) == f"NOT MET: name ({text}); not a number{place}"


def test_a_length_of_many_centimetres_is_shown_in_metres():
    shown = {
        (3.2, "cm"): "worst 3.2 cm",
        (-121195.0, "cm"): "worst -1211.95 m",
        (2500.0, "mm"): "worst 2.5 m",
        (2500.0, "m"): "worst 2500 m",
    }
    for (value, of), text in shown.items():
        assert Finding("far", "", MISSED, value, of).detail == text


@pytest.mark.parametrize(
    "text", ["a.x < 99 or time > 3", "a.x < 99 or a.angle < 99", "not (a.x < 99 and time < 3)"]
)
def test_where_the_other_part_decides_a_row_needs_no_number(gap, text):
    assert finding(gap, "name", text).verdict is (MISSED if "not" in text else MET)


@each(
    ("text", "reason"),
    [
        ("sin(a.x, a.x) > 1", r"sin\(x\): expected 1 argument, got 2"),
        ("a.x > " + "1" * 30_000, "expression is longer than 10000 characters"),
        ("a.x > " + "1" * 9_000, "a number in the expression has more than 300 digits"),
        (" + ".join(["a.x"] * 1_000) + " > 1", "expression is nested too deeply"),
        ("a.x > 1 m99", "there is no unit m99"),
        ("a.x > 1 km9" + ".km9" * 40 + "/m9" * 40 + "/m8", "has the factor inf"),
        ("a.X > 1", r"a\.X \(close: a\.x"),
        ("a.x > 1 kg", r"kg \[kg\] cannot be converted to m \[m\]"),
        ("a.x * a.x > 1 m", r"`1 m` \[m\], `a\.x \* a\.x` \[m2\]: m \[m\] cannot be converted to"),
        ("a.x > 1 parsec", "there is no unit parsec"),
        ("a.x + 1 s > 2", r"`1 s` \[s\], `a\.x` \[m\]: s \[s\] cannot be converted to m \[m\]"),
        ("a.x >= a.angle", r"`a\.angle` \[rad\], `a\.x` \[m\]: rad \[rad\] cannot be converted to"),
        ("a.x - norm(a.v) > 0", r"`norm\(a\.v\)` \[m/s\], `a\.x` \[m\]: m/s \[m\.s-1\] cannot be"),
        ("a.x >= 2 * a.on", r"`2 \* a\.on` \[1\], `a\.x` \[m\]: 1 \[1\] cannot be converted to m"),
        ("sqrt(a.x) >= a.km", r"of `sqrt\(a\.x\)`: the unit of `sqrt\(a\.x\)` is not known"),
        (
            "sqrt(a.x) >= 1 m",
            r"1 m: the unit of `sqrt\(a\.x\)` is not known; write the number " "without a unit",
        ),
        ("sin(a.x) > 0", r"`a\.x` \[m\], `rad` \[rad\]: m \[m\] cannot be converted to rad"),
        ("0 < 1", "`0 < 1` contains no variable, so its outcome is always the same"),
        ("a.x > 99 or 0 < 1", "`0 < 1` contains no variable"),
        ("always(0 < 1)", "`0 < 1` contains no variable"),
        ("a.x >= 0 & a.on", "`0 & a.on`: write `and`, `or`, `not` for"),
        ("a.x >= 0 # m", "`# m`: an expression cannot contain a comment"),
        ("a.x", "is not a condition"),
        ("a.x >", "is not an expression"),
        ("__import__('os') == 1", "there is no function __import__"),
        ("quantity(1, 0) > a.x", "quantity"),
        ("a.x < 9**9**9**9", ""),
        ("a.x ** 1e999 > 1", ""),
        ("a.x > 1e999 m", ""),
        ("(" * 300 + "a.x" + ")" * 300 + " > 1", "is not an expression"),
    ],
)
def test_a_requirement_that_is_not_judged_states_why(result, text, reason):
    found = finding(result, "name", text)
    if reason:
        assert found.verdict is OPEN
        assert re.search(reason, found.reason)
    else:
        assert found.verdict in {MET, MISSED}


@pytest.mark.parametrize(
    ("value", "given", "required", "right"),
    [
        (1, "deg", "rad", math.pi / 180),
        (3600, "arcsec", "deg", 1.0),
        (3.3, "m/min", "m/s", 0.055),
        (2, "kN", "N", 2000.0),
        (1, "kg.m/s2", "N", 1.0),
        (7, "1/(N.m)", "s2/(kg.m2)", 7.0),
        (1, "N.m.s", "kg.m2/s", 1.0),
        (50, "%", "1", 0.5),
        (1, "km^2", "m2", 1e6),
        (1000, "mrad", "rad", 1.0),
    ],
)
def test_units_convert_by_their_meaning(value, given, required, right):
    assert convert(value, given, required) == pytest.approx(right, rel=1e-15)


SIZES = {
    "%": (0.01, "1"),
    **{
        f"{prefix}{name}": (size, name)
        for name in "ms"
        for prefix, size in (("m", 1e-3), ("u", 1e-6))
    },
    **{"km": (1e3, "m"), "cm": (1e-2, "m"), "min": (60, "s"), "h": (3600, "s"), "g": (1e-3, "kg")},
    **{"mrad": (1e-3, "rad"), "deg": (math.pi / 180, "rad"), "arcmin": (1 / 60, "deg")},
    **{"arcsec": (1 / 3600, "deg"), "N": (1, "kg.m/s2"), "mN": (1e-3, "N"), "kN": (1e3, "N")},
    **{"J": (1, "N.m"), "W": (1, "J/s"), "Hz": (1, "1/s")},
}


def test_every_unit_is_as_large_as_its_name_states():
    assert {*SIZES} == {*SYMBOLS} - {"1", "m", "s", "kg", "rad"}
    for name, (size, of) in SIZES.items():
        assert convert(1.0, name, of) == pytest.approx(size, rel=1e-15), name


def test_the_units_of_all_fmus_have_a_meaning():
    from harness.system.interface import read_interface

    for path in paths.fmus().values():
        for name, base in read_interface(path).units.items():
            ours = dict(unit(name).base)
            theirs = {key: value for key, value in base.items() if value or key == "factor"}
            assert {k: v for k, v in ours.items() if v} == {k: v for k, v in theirs.items() if v}


# ---- in systems and on the command line


THEIRS = {
    "arguments": "sin(guidance.range, guidance.range) > 0",
    "digits": "guidance.range > " + "1" * 30_000,
    "terms": " + ".join(["guidance.range"] * 2_000) + " > 1 m",
    "times": " + ".join(["time"] * 1_000) + " > 1 s",
    "exponent": "guidance.range > 1 m" + "9" * 400,
}


def test_requirements_in_an_ssp_from_elsewhere_cost_neither_run_nor_report(tmp_path, capsys):
    with load("sync_approach") as system:
        write_ssp(replace(system, requirements=THEIRS), tmp_path / "theirs.ssp")
    out = str(tmp_path / "out.nc")
    assert main(["run", str(tmp_path / "theirs.ssp"), "--stop", "1", "-o", out]) == 0
    stated = capsys.readouterr().out
    assert [n for n in THEIRS if f"requirement not judged: {n} (" not in stated] == []
    assert main(["report", out]) == 1
    stated = capsys.readouterr().out
    assert [n for n in THEIRS if f"not judged: {n}" not in stated] == []


@pytest.mark.parametrize("name", THEIRS)
def test_such_a_requirement_is_rejected_on_the_command_line(tmp_path, name):
    out = str(tmp_path / "out.nc")
    text = THEIRS[name]
    assert main(["run", "sync_approach", "--stop", "1", "-o", out, "--require", text]) == 2


def test_a_system_carries_its_requirements_through_its_ssp(tmp_path):
    with load("sync_approach") as system:
        zone = "guidance.range >= min(parameter(monitor.keep_out_half))"
        assert system.requirements["distance"] == zone
        write_ssp(system, tmp_path / "again.ssp")
        with load(tmp_path / "again.ssp") as again:
            assert again.requirements == system.requirements


def test_a_run_retains_and_evaluates_them(tmp_path, capsys):
    out = tmp_path / "out.csv"
    required = ["--require", "guidance.range >= 1 km", "--stop", "1"]
    assert main(["run", "sync_approach", "-o", str(out), *required]) == 1
    text = capsys.readouterr()
    assert "requirement met: distance (guidance.range >= min(" in text.out
    assert "requirement NOT MET: guidance.range >= 1 km; worst 0.01" in text.err
    found = findings(read(out))
    assert [f.name for f in found] == [
        "distance",
        "tracking",
        "pointing",
        "attitude",
        "guidance.range >= 1 km",
    ]
    assert [f.verdict for f in found] == [MET, IDLE, IDLE, IDLE, MISSED]


def test_requirements_of_the_system_decide_only_if_strict(tmp_path, capsys):
    out = tmp_path / "out.nc"
    far = ["--set", "servicer.rho_0_H=[0,3,0]", "--stop", "1", "-o", str(out)]
    assert main(["run", "sync_approach", *far]) == 0
    assert "NOT MET: distance" in capsys.readouterr().out
    assert main(["run", "sync_approach", *far, "--strict", "-q"]) == 1
    assert "NOT MET: distance" in capsys.readouterr().err


def test_a_requirement_that_was_not_exercised_passes_no_gate(tmp_path, capsys):
    out = tmp_path / "out.nc"
    short = ["--stop", "1", "-o", str(out), "-q"]
    late = "time < 1 min or guidance.range > 4 m"
    assert main(["run", "sync_approach", *short]) == 0
    assert main(["run", "sync_approach", *short, "--require", late]) == 1
    reported = capsys.readouterr().err.splitlines()
    assert reported == [
        f"harness: requirement not exercised: {late}; it does not apply up to the end at 1 s"
    ]
    assert main(["run", "sync_approach", *short, "--strict"]) == 1
    reported = capsys.readouterr().err.splitlines()
    assert [line.split(" (")[0] for line in reported] == [
        "harness: requirement not exercised: tracking",
        "harness: requirement not exercised: pointing",
        "harness: requirement not exercised: attitude",
    ]
    assert main(["report", str(out), "-o", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert '<span class="chip idle">3 requirements not exercised</span>' in page
    assert page.count('<span class="badge idle">not exercised</span>') >= 3


def test_the_angle_between_attitudes():
    """Against the rotation of scipy, for angles down to 1e-9 rad and either sign."""
    axis = np.array([1.0, -2.0, 2.0]) / 3
    angles = np.array([0.0, 1e-9, 1e-3, 1.0, 3.0, math.pi])
    q = Rotation.from_rotvec([0.3, -1.2, 2.0])
    p = q * Rotation.from_rotvec(angles[:, None] * axis)
    sign = np.array([1, -1, 1, -1, 1, -1])[:, None]
    found = FUNCTIONS["angle"].value(np.tile(q.as_quat(), (6, 1)), sign * p.as_quat())
    close(found, angles, rel=1e-14)


@pytest.mark.parametrize(("powered", "verdict"), [(False, MISSED), (True, MET)])
def test_a_controller_without_torque_fails_the_attitude(powered, verdict):
    """The law with true inertia points; with all gains and estimates 0 its torque is 0."""
    sizes = {"K_att": 3, "P_att": 3, "eta_hat_0": 12}
    rest = {f"controller.{name}": [0.0] * size for name, size in sizes.items()}
    rest |= {"controller.Gamma_scale": 0.0, "controller.use_wheels": 0.0}
    given = {"params": "informed"} if powered else {"set": rest}
    result = run("sync_approach", every=100, **given)
    found = {f.name: f for f in findings(result)}
    assert found["attitude"].verdict is verdict
    late = result.time >= 29 * 60
    q, p = (result[name][late] for name in ("guidance.q_DN", "servicer.q_SN"))
    off = np.degrees(2 * np.arccos(np.abs(np.sum(q * p, axis=1))))
    assert found["attitude"].value == pytest.approx(off.max(), rel=1e-6)
    if not powered:
        assert off.max() > 90
        assert found["pointing"].verdict is MET


def test_a_violated_safety_rule_passes_no_strict_gate(tmp_path, capsys):
    inside = ["--set", "servicer.rho_0_H=[0,3,0]", "--stop", "1", "-o", str(tmp_path / "out.nc")]
    assert main(["run", "sync_approach", *inside, "-q"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["run", "sync_approach", *inside, "-q", "--strict"]) == 1
    assert "harness: safety rule keep-out: violated, first at 0.00 s" in capsys.readouterr().err


def test_report_evaluates_them_and_others(tmp_path, capsys):
    out = tmp_path / "out.nc"
    assert main(["run", "relay_approach", "--stop", "1", "-o", str(out), "-q"]) == 0
    assert main(["report", str(out), "--require", "guidance.rang > 1"]) == 1
    text = capsys.readouterr()
    assert "Requirements:\n  met: distance" in text.out
    assert "\n  not judged: guidance.rang > 1; guidance.rang (close: " in text.out


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("guidance.rang > 1", r"there is no variable guidance\.rang \(close: guidance\.range"),
        ("guidance.range > parameter(guidance.rho)", "there is no parameter guidance.rho"),
        ("guidance.range > 1 kg", "cannot be converted"),
        ("guidance.range", "is not a condition"),
    ],
)
def test_a_senseless_requirement_is_rejected_before_the_run(text, problem):
    with pytest.raises(UsageError, match=problem):
        run("sync_approach", stop=1.0, require=[text])


def test_a_requirement_whose_fmu_was_swapped_is_not_judged():
    result = run("sync_approach", stop=1.0, require={"own": "controller.m_hat > 0 kg"})
    assert findings(result)[-1].verdict is MET
    assert findings(result)[-1].name == "own"
    lost = run("sync_approach", stop=1.0, swap={"controller": "pid_controller"})
    assert all(f.verdict is not OPEN for f in findings(lost))
    assert finding(lost, "own", "controller.m_hat > 0 kg").verdict is OPEN


def test_the_build_reports_senseless_requirements():
    toml = paths.PACKAGE.parent / "ssp" / "sync_approach" / "system.toml"
    source = tomllib.loads(toml.read_text(encoding="utf-8"))
    source["requirements"] = {"a": "guidance.rang > 1", "b": "2 > 1 m"}
    with pytest.raises(StructureError) as rejected:
        system_of(source, paths.fmus())
    places = [line.partition(":")[0] for line in rejected.value.problems]
    assert places == ["requirements.a", "requirements.b"]


# ---- parameters that contradict each other

CONTRADICTIONS = {
    "start where the guidance begins": (
        ["servicer.rho_0_H=[0,30,0]"],
        "servicer.rho_0_H = 0 30 0 m, guidance.rho_0 = 20 m",
    ),
    "mass estimate near the mass": (
        ["servicer.mass_0=400"],
        "servicer.mass_0 = 400 kg, controller.m_hat_0 = 95 kg",
    ),
    "end outside the keep-out zone": (
        ["guidance.rho_M=3"],
        "guidance.rho_M = 3 m, monitor.keep_out_half = 4 4 4 m",
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_a_note_names_both_values_where_parameters_contradict(name, caplog):
    given, values = CONTRADICTIONS[name]
    run("sync_approach", set=given, stop=0.1)
    (line,) = [r.getMessage() for r in caplog.records if name in r.getMessage()]
    assert line.startswith(f"{name}: {values}; expected ")
    caplog.clear()
    verdict = check("sync_approach", set=given)
    assert [w for w in verdict.warnings if w == line]
    with pytest.raises(StructureError, match=f"warning: {name}"):
        check("sync_approach", strict=True, set=given)


DECIDED = {
    "servicer.mass >= 101 kg": "NOT MET: servicer.mass >= 101 kg; worst 100 kg at 0 s",
    "parameter(servicer.mass_0) >= 3 kg": "met: parameter(servicer.mass_0) >= 3 kg; worst 100 kg",
}


@pytest.mark.parametrize("text", DECIDED)
def test_check_warns_of_a_requirement_that_the_start_values_decide(text):
    verdict = check("sync_approach", require=[text, "guidance.range >= 3 m"])
    assert verdict.warnings == (
        f"{DECIDED[text]}; every run has this verdict: the start values decide it",
    )


def test_check_runs_no_code_of_a_third_party_fmu(fmus, tmp_path, monkeypatch):
    """The same system with a third-party FMU: no warning, and no step that could give one."""
    path = tmp_path / "demo.ssp"
    write_ssp(system_of(tomllib.loads(TOML), fmus), path)
    monkeypatch.setattr("harness.studies.check.simulate", pytest.fail)
    assert check(path, require=["twice.y >= 1e9"]).warnings == ()


def test_check_finds_the_start_values_of_a_system_of_several_rates():
    given = {"require": ["servicer.mass >= 101 kg"]}
    assert len(check("servicing_mission", **given).warnings) == 1
    assert not check("servicing_mission").warnings


def test_no_set_contradicts_itself_and_a_law_without_an_estimate_states_nothing(tmp_path):
    for name in ("sync_approach", "sync_approach_navigated", "sync_approach_thrusters"):
        assert not [w for w in check(name).warnings if "expected" in w]
    given = {"set": ["servicer.mass_0=400"], "swap": {"controller": "pid_controller"}}
    assert not [w for w in check("sync_approach", **given).warnings if "mass estimate" in w]
    with load("sync_approach") as system:
        write_ssp(system, tmp_path / "again.ssp")
        with load(tmp_path / "again.ssp") as again:
            assert again.consistency == system.consistency
            assert again.compared == system.compared == "limited"


def test_a_condition_on_what_varies_is_no_consistency(fmus):
    text = TOML + '\n[consistency]\nodd = "twice.y > 1"\n'
    with pytest.raises(StructureError, match=r"consistency\.odd: there is no variable twice.y"):
        system_of(tomllib.loads(text), fmus)
