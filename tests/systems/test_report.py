# SPDX-License-Identifier: BSD-2-Clause
"""The report as a page of HTML: for every kind of result, its numbers equal the result's, its
extremes survive, it needs nothing from elsewhere, and it states what is wrong.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from harness import run
from harness.api import write_page
from harness.claims.report import judgements
from harness.cli.app import main
from harness.errors import HarnessError
from harness.mission.library import everything, of_result
from harness.report import run as report_run
from harness.report import template
from harness.report.arrays import thinned_rows
from harness.report.run import of_run
from harness.results.files import ResultFile
from harness.results.requirements import findings
from harness.results.verdict import Kind, Verdict
from harness.ssp.library import load
from ssp.shared.bodies import uniform_box
from ssp.shared.safety import RESTING
from tests.each import some
from tests.harness.report_page import Page

RUNS = {
    "sync_approach": {"stop": 1300.0, "every": 5},
    "sync_approach_thrusters": {"stop": 30.0},
    "relay_approach": {"stop": 600.0, "every": 5},
    "ppc_tracking": {"stop": 20.0},
    "arch_rendezvous": {"stop": 2000.0, "every": 50},
    "space_robot": {"params": "joint_motion", "stop": 600.0},
    "transposition": {"stop": 2400.0},
    "servicing_mission": {"stop": 20.0},
    "arm_capture": {"stop": 40.0, "every": 10},
}
PAIRS = [system for system in RUNS if system not in ("space_robot", "transposition")]
"""A short run of every kind of system."""
LARGEST = 6_000_000
"""Bytes of a page."""


@cache
def result_of(system):
    return run(system, **RUNS[system])


@cache
def page_of(system):
    return Page(of_run(result_of(system)))


def sketch_of(result):
    """The page of a run without its figures, where a test does not look at them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.report.run.figures_of", lambda _: (), raising=False)
        return of_run(result)


each_system = pytest.mark.parametrize("system", some(RUNS, 2))


# ---- every system


@each_system
def test_a_page_is_whole_and_needs_nothing_from_elsewhere(system):
    page = page_of(system)
    assert page.size < LARGEST
    assert not [link for link in page.links if not link.startswith("#")]
    assert page.is_closed()
    assert {"script-plotly", "script-k3d", "replay", "plots", "signals"} <= page.ids
    assert not page.alerts


@each_system
def test_the_head_states_what_the_run_is_and_how_it_ended(system):
    """The description of the system, the end, and the verdicts of the requirements."""
    page, result = page_of(system), result_of(system)
    with load(system) as found:
        assert page.headings[0] == f"{found.description}, {result.time[-1]:g} s"
    text = " ".join(page.text.split())
    assert f"Ended at {result.time[-1]:g} s" in text
    count = len(findings(result))
    assert not count or f" of {count} requirements " in text


def test_every_headline_value_has_a_definition():
    shown = {m.name: m.meaning for m in everything().metrics if not m.beside}
    assert len(shown) > 30
    assert not [name for name, meaning in shown.items() if not meaning.endswith(".")]


@each_system
def test_all_variables_are_in_the_page_with_their_numbers(system):
    page, result = page_of(system), result_of(system)
    for name in result.vectors:
        values = result[name].reshape(len(result.time), -1)
        plot = page.signal(name)
        if plot is None:
            assert (values == values[0]).all(), name
            continue
        assert len(plot["curves"]) == values.shape[1], name
        assert result.unit(name) in plot["y"]
        for curve, column in zip(plot["curves"], values.T, strict=True):
            if name.endswith("_margin"):
                column = np.where(column < RESTING, column, np.nan)
            x, y = page.array(curve["x"]), page.array(curve["y"])
            rows = np.searchsorted(result.time.astype("f4"), x)
            np.testing.assert_array_equal(y, column.astype("f4")[rows], err_msg=name)
            if np.isfinite(column).any():
                assert np.nanmin(y) == np.float32(np.nanmin(column)), name
                assert np.nanmax(y) == np.float32(np.nanmax(column)), name


@each_system
def test_the_figures_are_those_that_fit(system):
    page, result = page_of(system), result_of(system)
    offered = of_result(result).figures
    fitting = {f.name for f in offered if f.fits(result) and not f.is_empty(result)}
    in_space = {"bodies"}
    assert set(page.figures()) - {"phases"} == fitting - in_space
    for name, plots in page.figures().items():
        assert all(page.array(c.get("y") or c["image"]).size for p in plots for c in p["curves"]), (
            name
        )


@each_system
def test_parameters_and_claims_are_shown(system):
    page, result = page_of(system), result_of(system)
    for name in result.parameters.vectors:
        assert name in page.text
    for each in judgements(result):
        for claim, judgement in each.claims:
            assert claim.text in page.text
            assert judgement.value in page.text


# ---- replay


def turned(q, v):
    """v_N of v_B for quaternions scalar first."""
    return Rotation.from_quat(q[:, [1, 2, 3, 0]]).apply(v)


def instants(page, result):
    """Rows of the replay in the result."""
    time = page.array(page.data["scene"]["time"])
    return np.searchsorted(result.time.astype("f4"), time)


@pytest.mark.parametrize("system", ["sync_approach", "arch_rendezvous"])
def test_the_replay_in_the_hill_frame_is_what_the_run_software_sees(system):
    """rho_H of guidance or controller, of the sample before, against positions turned here."""
    result = run(system, stop=200.0)
    page = Page(sketch_of(result))
    source = "guidance.rho_H" if "guidance.rho_H" in result else "controller.rho_H"
    r, hill = page.array(page.body("servicer")["r"]), page.array(page.data["scene"]["hill"])
    rows = instants(page, result)[:-1]
    seen = Rotation.from_quat(hill[:-1, [1, 2, 3, 0]]).inv().apply(r[:-1])
    size = np.linalg.norm(r, axis=1).max()
    np.testing.assert_allclose(seen, result[source][rows + 1], atol=1e-6 * size)


@pytest.mark.parametrize("system", PAIRS)
def test_bodies_move_as_in_the_result(system):
    page, result = page_of(system), result_of(system)
    rows = instants(page, result)
    assert (rows[0], rows[-1]) == (0, len(result.time) - 1)
    r, q = (page.array(page.body("servicer")[key]) for key in ("r", "q"))
    apart = r - page.array(page.body("target")["r"])
    expected = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[rows]
    np.testing.assert_allclose(apart, expected, atol=2e-7 * np.abs(expected).max())
    np.testing.assert_array_equal(q, result["servicer.q_SN"][rows].astype("f4"))
    assert np.ptp(r, axis=0).max() > 0


def test_deep_space_has_no_hill_frame_and_an_orbit_has():
    assert [f["key"] for f in page_of("relay_approach").data["scene"]["frames"]] == ["N"]
    assert [f["key"] for f in page_of("sync_approach").data["scene"]["frames"]] == ["H", "N"]


def tip_of(page, k, tip):
    """Return a point of the last link of a body in its axes at instant k of the replay."""
    body = page.data["scene"]["bodies"][0]
    place = np.array(tip, dtype=float)
    for link in reversed(body["links"]):
        angle = np.atleast_2d(page.array(link["angle"]).T).T[k, link["index"]]
        place = np.array(link["at"]) + Rotation.from_rotvec([0, 0, angle]).apply(place)
    return place


def test_links_of_the_robot_reach_where_its_joint_angles_state():
    """x = r0 + (l1 + r1) cos q1 + s cos (q1 + q2), y likewise: the tip s of link 2."""
    page, result = page_of("space_robot"), result_of("space_robot")
    rows, r, inner = (
        instants(page, result),
        result.parameter("robot.r"),
        result.parameter("robot.l"),
    )
    q1, q2 = result["robot.joint_angle"].T
    assert np.ptp(q1) > 0.3
    for k in (0, len(rows) // 2, len(rows) - 1):
        a, b = q1[rows[k]], q1[rows[k]] + q2[rows[k]]
        long = inner[1] + r[1]
        expected = (r[0] + long * np.cos(a) + 2 * np.cos(b), long * np.sin(a) + 2 * np.sin(b), 0)
        np.testing.assert_allclose(tip_of(page, k, (2, 0, 0)), expected, atol=1e-6)


def in_parent(link, angle, place):
    """A point of a link in the axes of what carries it."""
    turn = Rotation.from_rotvec(np.array(link["axis"]) * angle)
    return np.array(link["at"]) + turn.apply(place)


def test_links_of_an_arm_reach_the_end_effector():
    """Down the links of the page to the fingers: where the plant has E, also for a tool that is
    turned on the last link.
    """
    tool = {"servicer.p_EA_A": [0.3, 0.1, -0.2], "servicer.q_EA": [0.6, 0, 0, 0.8]}
    result = run("arm_capture", stop=40.0, every=10, set=tool)
    page = Page(sketch_of(result))
    body, rows = page.body("servicer"), instants(page, result)
    links = body["links"]
    assert [link.get("on", -1) for link in links] == list(range(-1, 6))
    angles, finger = page.array(links[0]["angle"]), links[-1]["parts"][-1]
    assert np.ptp(angles, axis=0).min() > 0.01
    for k in (0, len(rows) // 2, len(rows) - 1):
        place, palm = np.array(finger["to"]), np.array(links[-1]["parts"][-3]["to"])
        for link in reversed(links):
            place, palm = (in_parent(link, angles[k, link["index"]], p) for p in (place, palm))
        row = rows[k]
        from_N = Rotation.from_quat(result["servicer.q_SN"][row, [1, 2, 3, 0]]).inv()
        expected = from_N.apply(result["servicer.r_EN_N"][row] - result["servicer.r_SN_N"][row])
        np.testing.assert_allclose(place, expected, atol=2e-6)
        pointing = Rotation.from_quat(result["servicer.q_EN"][row, [1, 2, 3, 0]]).apply([1, 0, 0])
        forward = (place - palm) / np.linalg.norm(place - palm)
        np.testing.assert_allclose(forward, from_N.apply(pointing), atol=1e-5)


def test_modes_of_the_arm_and_its_path_are_in_the_replay():
    page, result = page_of("arm_capture"), result_of("arm_capture")
    tip = page.array(page.body("end effector")["r"])
    expected = result["servicer.r_EN_N"] - result["target.r_TN_N"]
    np.testing.assert_allclose(tip, expected[instants(page, result)], atol=2e-6)
    scene = page.data["scene"]
    assert [b["name"] for b in scene["bodies"]] == ["servicer", "end effector", "target"]
    spoken = [(e["time"], e["text"]) for e in scene["events"] if e["kind"] == "phase"]
    began = result.time[result["arm_guidance.arm_mode"] == 1][0]
    assert spoken == [(0, "arm stowed"), (began, "arm deploy")]
    assert [(p["begin"], p["text"]) for p in scene["phases"]] == spoken


def test_boxes_of_the_robot_have_the_lengths_of_its_links():
    """The links of the paper are rods of 2 m whose centres of mass are in the middle."""
    links = page_of("space_robot").data["scene"]["bodies"][0]["links"]
    for link in links:
        box = next(p for p in link["parts"] if p["kind"] == "box")
        assert box["size"][0] == pytest.approx(2, rel=0.01)
        assert box["at"] == [1, 0, 0]


def test_the_module_swings_about_the_hinge():
    page, result = page_of("transposition"), result_of("transposition")
    rows = instants(page, result)
    hinge, module = (result.parameter(f"assembly.{n}") for n in ("hinge", "module"))
    angle = result["assembly.arm_angle"][rows]
    assert np.ptp(angle) > 0.5
    for k in (0, len(rows) // 2, len(rows) - 1):
        c, s = np.cos(angle[k]), np.sin(angle[k])
        expected = hinge + np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ module
        np.testing.assert_allclose(tip_of(page, k, module), expected, atol=1e-5)


def test_the_assembly_in_the_hill_frame_has_the_attitude_of_the_plant():
    page, result = page_of("transposition"), result_of("transposition")
    rows, hill = instants(page, result), page.array(page.data["scene"]["hill"])
    q = page.array(page.body("base")["q"])
    to_hill = Rotation.from_quat(hill[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(
        q[:, [1, 2, 3, 0]]
    )
    known = Rotation.from_quat(result["assembly.q_SH"][rows][:, [1, 2, 3, 0]])
    assert (to_hill * known.inv()).magnitude().max() < 1e-5
    planet = (
        Rotation.from_quat(hill[:, [1, 2, 3, 0]])
        .inv()
        .apply(page.array(page.data["scene"]["planet"]["r"]))
    )
    radius = float(result.parameter("assembly.R_C"))
    np.testing.assert_allclose(planet, np.tile([-radius, 0, 0], (len(rows), 1)), atol=1e-6 * radius)


def test_plumes_blow_against_the_commanded_force():
    """The sum of all plumes, each against its direction, is the mean command."""
    page, result = page_of("sync_approach"), result_of("sync_approach")
    plumes = page.data["scene"]["plumes"]
    rows = instants(page, result)
    shares = [np.clip(page.array(p["share"]), 0, 1) for p in plumes]  # as the page draws them
    push = sum(np.outer(s, -np.array(p["out"])) for s, p in zip(shares, plumes, strict=True))
    force = result["controller.F_cmd_S"]
    means = [force[a:b].mean(axis=0) for a, b in zip(rows, [*rows[1:], len(force)], strict=True)]
    largest = np.abs(force).max()
    np.testing.assert_allclose(push, np.array(means) / largest, atol=1e-6)


def test_thrusters_are_where_the_parameters_state():
    page, result = page_of("relay_approach"), result_of("relay_approach")
    plumes = page.data["scene"]["plumes"]
    assert len(plumes) == 13
    places = result.parameter("propulsion.thruster_position") - result.parameter(
        "propulsion.centre_of_mass"
    )
    np.testing.assert_allclose([p["at"] for p in plumes], places[:13])
    directions = result.parameter("propulsion.thruster_direction")[:13]
    np.testing.assert_allclose([p["out"] for p in plumes], -directions)


def test_zones_match_the_monitor():
    zones = {m["kind"]: m for m in page_of("arch_rendezvous").data["scene"]["zones"]}
    assert zones["cuboid"]["half"] == [0.2, 0.2, 0.2]
    assert zones["cone"]["axis"] == [-1, 0, 0]
    assert zones["cone"]["angle"] == pytest.approx(np.radians(30))


def test_probe_and_drogue_are_where_the_mechanism_has_them():
    """Tip in drogue axes and misalignment of the mechanism, from the parts of the page; its sample
    of row 0 is the row itself.
    """
    ports = {
        "mechanism.p_PS_S": [1.1, 0.2, -0.1],
        "mechanism.q_PS": [0.8, 0, 0.6, 0],
        "mechanism.p_QT_T": [0.3, -0.5, 0.2],
        "mechanism.q_QT": [0.6, 0, 0, 0.8],
    }
    result = run("servicing_mission", stop=0.2, set=ports)
    page = Page(sketch_of(result))
    at, out = {}, {}
    for body, kind in (("servicer", "rod"), ("target", "cup")):
        data = page.body(body)
        *_, part = (p for p in data["parts"] if p["kind"] == kind)
        attitude = Rotation.from_quat(page.array(data["q"])[0, [1, 2, 3, 0]])
        begin, end = (attitude.apply(part[key]) for key in ("from", "to"))
        at[body] = page.array(data["r"])[0] + end
        out[body] = (end - begin) / np.linalg.norm(end - begin)
    e, tip = at["servicer"] - at["target"], result["mechanism.tip_Q"][0]
    assert e @ out["target"] == pytest.approx(tip[0], abs=1e-4)
    assert np.linalg.norm(e) == pytest.approx(np.linalg.norm(tip), abs=1e-4)
    apart = np.arccos(-out["servicer"] @ out["target"])
    assert apart == pytest.approx(result["mechanism.misalignment"][0], abs=1e-5)


def test_phases_and_events_run_along_with_a_mission(capsys, tmp_path):
    """A run whose phases are set by hand: words of the numbers, events at their instants, the same
    in the report on the terminal.
    """
    simulated = result_of("servicing_mission")
    values, column = simulated.values.copy(), simulated.columns.index
    values[100:, column("manager.phase")] = 13
    values[100:, column("manager.reason")] = 2
    values[100:, column("manager.t_phase")] = simulated.time[100]
    result = replace(simulated, values=values)
    page = Page(sketch_of(result))
    scene = page.data["scene"]
    latch, force = scene["numbers"]
    assert [phase["text"] for phase in scene["phases"]] == ["far", "safe"]
    assert latch["words"][int(page.array(latch["values"])[0])] == "free"
    assert (force["name"], force["unit"]) == ("force on the probe", "N")
    stated = [(e["time"], e["text"], e["kind"]) for e in scene["events"]]
    assert stated[0] == (0, "far", "phase")
    assert (simulated.time[100], "safe (ground)", "abort") in stated
    assert [time for time, *_ in stated] == sorted(time for time, *_ in stated)
    ResultFile(tmp_path / "out.nc").write(result)
    main(["report", str(tmp_path / "out.nc")])
    reported = capsys.readouterr().out
    assert "Notes:" in reported
    assert "10.0 s: safe (ground)" in reported
    assert "time line: far 10 s, safe 10 s" in reported


@given(st.lists(st.floats(0.1, 10), min_size=3, max_size=3), st.floats(1, 1e4))
def test_the_box_of_uniform_density_comes_back_from_its_inertia(edges, mass):
    a, b, c = edges
    inertia = mass / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    slim = np.maximum(edges, 0.15 * max(edges))
    np.testing.assert_allclose(uniform_box(mass, np.diag(inertia)), slim, rtol=1e-6)


# ---- thinning


@given(
    arrays(float, st.integers(1, 400), elements=st.floats(-1e6, 1e6) | st.just(float("nan"))),
    st.integers(4, 60),
)
def test_thinned_rows_retain_extremes_ends_and_gaps(values, points):
    rows = thinned_rows(values, points)
    assert len(rows) <= 1.5 * points + 4 or len(rows) == len(values)
    assert (np.diff(rows) > 0).all()
    assert rows[0] == 0
    assert rows[-1] == len(values) - 1
    retained = values[rows]
    if np.isfinite(values).any():
        assert np.nanmin(retained) == np.nanmin(values)
        assert np.nanmax(retained) == np.nanmax(values)
    assert np.isnan(retained).any() == np.isnan(values).any()


def test_a_spike_of_one_row_survives_and_the_page_states_that_it_is_thinned():
    result = run("sync_approach", stop=600.0)
    values = result.values.copy()
    column = result.columns.index("guidance.range")
    values[4321, column] = 77.0
    page = Page(sketch_of(replace(result, values=values)))
    curve = page.signal("guidance.range")["curves"][0]
    x, y = page.array(curve["x"]), page.array(curve["y"])
    assert len(y) < len(result.time)
    assert x[y == 77.0] == np.float32(result.time[4321])
    assert "include the smallest and the largest" in page.text


# ---- settings


def test_the_page_states_what_was_simulated_and_what_was_changed():
    result = run("sync_approach", every=10, set={"servicer.mass_0": 93.5})
    page = Page(sketch_of(result))
    for line in result.provenance.lines():
        assert line in page.text
    assert "servicer.mass_0 changed 93.5 kg" in page.text
    assert page.text.count("not the case of the paper") > 1


def test_requirements_are_in_the_page_with_their_worst_instant(tmp_path, capsys):
    result = result_of("ppc_tracking")
    ResultFile(tmp_path / "out.nc").write(result)
    worst = int(np.argmin(result["guidance.range"]))
    required = ("guidance.range >= 250 m", "guidance.range <= 400 m")
    given = [part for text in required for part in ("--require", text)]
    page = tmp_path / "r.html"
    assert main(["report", str(tmp_path / "out.nc"), "-o", str(page), *given]) == 1
    assert "guidance.range >= 250 m" in capsys.readouterr().err
    text = Page(page.read_text(encoding="utf-8")).text
    own = Counter(found.verdict for found in findings(result))
    for verdict in (Verdict.MET, Verdict.NOT_MET):  # the system's requirements and one of the user
        number = own[verdict] + 1
        word = Kind.REQUIREMENT.word(verdict)
        assert f" {number} requirement{'s' if number > 1 else ''} {word} " in text
    reported = f"{result['guidance.range'][worst]:.6g} m at {result.time[worst]:g} s"
    assert reported in text


# ---- the timeline


def test_the_head_begins_with_what_is_worst():
    """Two rules and a requirement that fail come before all that holds."""
    result = replace(violated(result_of("servicing_mission")), complete=True)
    looks = [look for look, _ in report_run.chips(result)]
    assert looks == sorted(looks, key=report_run.WORST_FIRST.index)
    assert report_run.chips(result)[0] == ("bad", "2 safety rules violated")
    assert ("none", "complete") in report_run.chips(result)  # the run, not what it was for
    text = Page(sketch_of(result)).text
    assert text.index("2 safety rules violated") < text.index("complete")


def test_headline_values_without_a_unit_are_words_or_bare_numbers():
    """A mission under way has not captured: "no", not "0 1"."""
    text = sketch_of(result_of("servicing_mission"))
    tiles = dict(re.findall(r"<span>([^<]*)</span><b>([^<]*<small>[^<]*)</small></b></div>", text))
    assert tiles["captured"] == "no<small> "
    assert tiles["under way"] == "yes<small> "
    assert tiles["minimum range"].endswith("<small> m")


def test_the_final_approach_is_not_drawn_before_it_has_begun():
    result = result_of("servicing_mission")
    drawn = {figure.name: figure for figure in of_result(result).figures}
    assert drawn["corridor"].is_empty(result)


def test_many_notes_are_folded_below_the_verdicts(monkeypatch):
    """A mission notes each of its phases: the replay is still near the top."""
    result, notes = result_of("sync_approach"), ["note 1 of 3", "note 2", "note 3"]
    monkeypatch.setattr(report_run, "notes", lambda of: notes)
    text = sketch_of(result)
    assert '<div class="note">' not in text
    chips, folded = text.index('class="chips"'), text.index('<details class="settings notes">')
    assert chips < folded < text.index(notes[0]) < text.index('id="replay"')
    del notes[2]
    text = sketch_of(result)
    assert text.index('<div class="note">note 1') < text.index('class="chips"')


def test_claims_of_several_papers_are_counted_together():
    result = result_of("arm_capture")
    verdicts = [each.verdict for paper in judgements(result) for _, each in paper.claims]
    assert len(judgements(result)) == 2
    count = verdicts.count(Verdict.REPRODUCED)
    texts = [text for _, text in report_run.chips(result) if "claim" in text]
    assert f"{count} claims reproduced" in texts
    assert len({text.split(" ", 2)[2] for text in texts}) == len(texts)


def violated(result):
    """A run with the first violations of keep-out zone and corridor at 5 and 7 s, an abort at 7
    s.
    """
    values, column = result.values.copy(), result.columns.index
    for rule, name, when in ((1, "keep_out", 5.0), (2, "corridor", 7.0)):
        late = result.time >= when
        values[late, column(f"monitor.t_first[{rule}]")] = when
        values[late, column(f"monitor.{name}_margin")] = -1.0
        values[late, column(f"monitor.least_margin[{rule}]")] = -1.0
    values[result.time >= 7, column("monitor.abort")] = 1
    return replace(result, values=values)


def test_violations_and_aborts_are_events_and_states_of_zones():
    result = violated(result_of("servicing_mission"))
    page = Page(sketch_of(result))
    scene = page.data["scene"]
    stated = [(e["time"], e["kind"]) for e in scene["events"]]
    assert (5, "violation") in stated
    assert (7, "violation") in stated
    assert (7, "abort") in stated
    time = page.array(scene["time"])
    zone = next(m for m in scene["zones"] if m["kind"] == "ellipsoid")
    assert zone["text"] == "keep-out zone, 12 m"
    np.testing.assert_array_equal(page.array(zone["state"]) == 2, time >= 5)
    rules = {rule["name"]: rule["violated"] for rule in scene["rules"]}
    assert (rules["keep-out"], rules["corridor"]) == (5, 7)


def test_an_escape_margin_below_its_reserve_is_a_violated_rule():
    """The margin is 0.5 m from 4 s on, the reserve 1 m, and the rule is violated at 5 s."""
    result = result_of("servicing_mission")
    values, column = result.values.copy(), result.columns.index
    values[:, column("monitor.escape_margin")] = np.where(result.time < 4, 3.0, 0.5)
    late = result.time >= 5
    values[:, column("monitor.violated[7]")] = late
    values[late, column("monitor.t_first[7]")] = 5
    values[:, column("monitor.least_margin[7]")] = values[:, column("monitor.escape_margin")]
    page = Page(sketch_of(replace(result, values=values)))
    escape = next(rule for rule in page.data["scene"]["rules"] if rule["name"] == "escape")
    time = page.array(page.data["scene"]["time"])
    np.testing.assert_array_equal(page.array(escape["state"]), np.where(time < 5, 1, 2))


def test_the_earth_turns_and_the_sun_is_placed_by_the_date():
    """A dated run; Greenwich looks where the equation of the equinoxes has it, within a minute of
    arc of the angle of 280.46 deg at J2000.
    """
    dated = run("ppc_tracking", stop=20.0, epoch="2000-01-01T12:00:00")
    page = Page(sketch_of(dated))
    scene, bare = page.data["scene"], page_of("ppc_tracking").data["scene"]
    turn = page.array(scene["planet"]["turn"])
    assert np.degrees(turn[0]) % 360 == pytest.approx(280.46, abs=0.02)
    assert (turn[-1] - turn[0]) / 20 == pytest.approx(7.292115e-5, rel=0.02)
    assert scene["planet"]["coasts"]
    assert "undated" not in scene
    assert bare["undated"].startswith("no date")
    assert page.array(scene["sun"]["towards"]).shape == (len(turn), 3)
    assert page_of("ppc_tracking").array(bare["sun"]["towards"]).shape == (1, 3)


# ---- what is wrong is stated


def test_an_incomplete_run_states_so_at_the_top():
    result = replace(result_of("sync_approach"), complete=False, message="a <b> failed at 3 s")
    page = Page(sketch_of(result))
    assert " ".join(page.alerts) == "Incomplete run. a <b> failed at 3 s"


def test_a_result_without_bodies_or_parameters_has_a_page(tmp_path):
    result = result_of("ppc_tracking")
    ResultFile(tmp_path / "bare.csv").write(result)
    page = Page(write_page(tmp_path / "bare.csv", tmp_path / "bare.html").read_text())
    assert page.data["scene"] is not None
    columns = [i for i, c in enumerate(result.columns) if c.startswith("controller.")]
    part = replace(
        result,
        columns=tuple(result.columns[i] for i in columns),
        units=tuple(result.units[i] for i in columns),
        descriptions=(),
        values=result.values[:, columns],
        parameters=None,
    )
    page = Page(sketch_of(part))
    assert page.data["scene"] is None
    assert page.signal("controller.a_cmd_L") is not None


@pytest.mark.parametrize("rows", [0, 1])
def test_a_result_of_no_duration_has_a_page(rows):
    result = result_of("ppc_tracking")
    short = replace(result, time=result.time[:rows], values=result.values[:rows], complete=False)
    page = Page(sketch_of(short))
    assert page.alerts
    assert page.data["scene"] is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, [1.5e308, -1.5e308]])
@pytest.mark.parametrize("name", ["servicer.r_SN_N", "guidance.rho_H"])
def test_values_that_cannot_be_drawn_are_named_and_left_out(name, value):
    """JSON has no word for values that are not finite, and no browser reads a page that holds one.
    An axis over both of the large ones would overflow.
    """
    result = result_of("sync_approach")
    values = result.values.copy()
    values[3:5, result.vectors[name][1]] = value
    with np.errstate(over="ignore"):
        page = Page(sketch_of(replace(result, values=values)))
    numbers = [page.scripts[part] for part in ("data", "arrays")]
    assert [json.loads(text, parse_constant=pytest.fail) for text in numbers]
    assert f"left out of plots and replay: {name} in 2 of {len(result.time)} rows" in page.text
    for body in page.data["scene"]["bodies"]:
        assert np.isfinite(page.array(body["r"])).all()
    assert "not finite" not in page_of("sync_approach").text


def test_corrupt_and_missing_files_are_reported_in_one_line(tmp_path, capsys):
    (tmp_path / "bad.nc").write_bytes(b"no netCDF")
    for name in ("bad.nc", "none.nc"):
        assert main(["report", str(tmp_path / name), "-o", str(tmp_path / "r.html")]) == 1
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert name in error
    assert not (tmp_path / "r.html").exists()


def test_a_missing_library_names_the_extra(monkeypatch):
    template._script.cache_clear()
    monkeypatch.setitem(sys.modules, "k3d", None)
    monkeypatch.setattr("harness.errors.find_spec", lambda name: None)
    with pytest.raises(
        HarnessError, match=r"library plotly: pip install 'servicing-fmus\[report\]'"
    ):
        template._script("plotly")
    template._script.cache_clear()


def test_the_command_writes_the_page(tmp_path, capsys):
    ResultFile(tmp_path / "out.nc").write(result_of("ppc_tracking"))
    page = tmp_path / "deep" / "report.html"
    assert main(["report", str(tmp_path / "out.nc"), "-o", str(page)]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    assert Page(page.read_text()).headings[0].startswith("Approach and tracking of")
