# SPDX-License-Identifier: BSD-2-Clause
"""Reports in a browser: no error, plots hold what the file holds, bodies move, controls work, and
a phone shows it all. Run by make test-browser.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness import run
from harness.api import write_page
from tests.harness.chromium import opened, wait

RUNS = {
    "sync_approach": {"every": 10},
    "sync_approach_thrusters": {"stop": 100.0},
    "sync_approach_thrusters_navigated": {"stop": 60.0},
    "sync_approach_navigated": {"stop": 60.0},
    "relay_approach": {"stop": 8000.0, "every": 10},
    "relay_approach_navigated": {"stop": 600.0, "every": 10},
    "ppc_tracking": {"stop": 60.0},
    "ppc_tracking_navigated": {"stop": 30.0},
    "arch_rendezvous": {"every": 100},
    "space_robot": {"params": "joint_motion"},
    "transposition": {},
    "servicing_mission": {},
    "arm_capture": {},
}
SYSTEM = "sync_approach"
TANKS = [[0, 0, 0.25], [0, 0, -0.25]]
"""Rest positions of the slosh masses of flexible_servicer."""
INTRUDER = """async () => {
    const blocked = [], place = document.querySelector("footer");
    document.addEventListener("securitypolicyviolation", ({ effectiveDirective }) =>
        blocked.push(effectiveDirective));
    const script = document.createElement("script");
    script.textContent = "window.intruder = true";
    place.append(script);
    place.innerHTML += `<iframe src="https://example.org/"></iframe>
        <img src="https://example.org/a.png" onerror="window.intruder = true">
        <p style="background: url(https://example.org/b.png)">text</p>`;
    await fetch("https://example.org/").catch(() => null);
    await new Promise((done) => setTimeout(done, 200));
    return blocked;
}"""
"""Directives of the policy of a page that block injected content."""
each_system = pytest.mark.parametrize("system", RUNS)
pytestmark = pytest.mark.browser


def scroll_through(page):
    """Every plot comes into sight once."""
    for box in page.query_selector_all("details.component"):
        box.evaluate("box => { box.open = true; }")
    for plot in page.query_selector_all(".plot"):
        if plot.is_visible():
            plot.scroll_into_view_if_needed()
    page.wait_for_timeout(300)


def frame_of(page):
    """The picture of the stage without its words, read in the task that has drawn it: later the
    canvas is cleared.
    """
    page.wait_for_timeout(250)
    return page.evaluate(
        """() => { report.replay.compose(false);
                   return document.querySelector('.stage canvas').toDataURL(); }"""
    )


@each_system
def test_a_report_opens_without_error_and_its_plots_hold_the_data(chromium, report_of, system):
    path, _ = report_of(system)
    with opened(chromium, path) as page:
        scroll_through(page)
        drawn = page.evaluate(
            """plotCards.map(e => ({drawn: e.drawn,
                   curves: e.plot.curves.length,
                   traces: (e.drawing.data || []).length,
                   points: (e.drawing.data || []).map(t => (t.y || t.z).length)}))"""
        )
        assert all(card["drawn"] for card in drawn)
        assert all(card["traces"] >= card["curves"] and min(card["points"]) for card in drawn)
        lines = page.evaluate("document.querySelectorAll('.scatterlayer .trace').length")
        assert lines >= sum(card["curves"] for card in drawn) - len(drawn)


def test_injected_content_of_a_page_neither_runs_nor_loads(chromium, report_of):
    path, _ = report_of(SYSTEM)
    page = chromium.new_page()
    page.goto(path.absolute().as_uri())
    wait(page, "window.report && window.report.ready")
    blocked = page.evaluate(INTRUDER)
    assert set(blocked) == {
        "script-src-elem", "script-src-attr", "img-src", "frame-src", "connect-src",
    }  # fmt: skip
    assert not page.evaluate("window.intruder")
    page.close()


@each_system
def test_bodies_move_and_two_frames_differ(chromium, report_of, system):
    path, result = report_of(system)
    begin, end = result.time[0], result.time[-1]
    with opened(chromium, path) as page:
        page.evaluate(f"report.replay.seek({begin})")
        first, before = frame_of(page), page.evaluate("report.replay.state()")
        page.evaluate(f"report.replay.seek({(begin + end) / 2})")
        second, after = frame_of(page), page.evaluate("report.replay.state()")
        assert before["bodies"] != after["bodies"]
        assert first != second
        page.evaluate("report.replay.play(true)")
        page.wait_for_timeout(700)
        assert page.evaluate("report.replay.state().time") > after["time"]


@pytest.mark.parametrize("rows", [slice(3, 4), slice(None)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_page_of_values_that_are_not_finite_opens(chromium, report_of, tmp_path, rows, value):
    _, result = report_of(SYSTEM)
    values = result.values.copy()
    values[rows] = value
    path = write_page(replace(result, values=values), tmp_path / "page.html")
    with opened(chromium, path) as page:
        scroll_through(page)
        assert page.evaluate("!!report.replay") == (rows != slice(None))


def test_bodies_are_where_the_result_states(chromium, report_of):
    """In N axes at an instant between two rows of the replay."""
    path, result = report_of(SYSTEM)
    rho = result["servicer.r_SN_N"] - result["target.r_TN_N"]
    with opened(chromium, path) as page:
        page.click("[data-frame=N]")
        for time in (0.0, 333.4, 1234.5, 1800.0):
            page.evaluate(f"report.replay.seek({time})")
            state = page.evaluate("report.replay.state()")
            expected = [np.interp(time, result.time, axis) for axis in rho.T]
            assert state["frame"] == "N"
            np.testing.assert_allclose(state["bodies"]["servicer"]["position"], expected, atol=2e-3)


def test_panels_bend_and_propellant_slides_as_the_result_states(chromium, tmp_path):
    """Where the panels are bent most: the joints of the picture have the angles of the rows, the
    masses their displacements.
    """
    result = run("ppc_tracking", swap=["servicer=flexible_servicer"], stop=10.0)
    path = write_page(result, tmp_path / "flexible.html")
    k = int(np.abs(result["servicer.panel_angle"][:, 0]).argmax())
    angles = result["servicer.panel_angle"][k, :2]
    slides = result["servicer.slosh_displacement"][k, :2]
    assert abs(angles[0]) > 0.05
    with opened(chromium, path) as page:
        page.evaluate(f"report.replay.seek({result.time[k]})")
        body = page.evaluate("report.replay.state()")["bodies"]["servicer"]
        sines = [joint[2] for joint in body["joints"][:2]]
        np.testing.assert_allclose(sines, np.sin(angles / 2), atol=1e-4)
        moved = [np.subtract(p, q) for p, q in zip(body["places"][3::2], TANKS, strict=True)]
        np.testing.assert_allclose(moved, np.diag(slides) @ np.eye(2, 3), atol=1e-4)


def test_controls_work(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path) as page:
        state = lambda: page.evaluate("report.replay.state()")  # noqa: E731
        page.click(".play")
        assert state()["playing"]
        page.click(".play")
        assert not state()["playing"]
        page.fill(".scrub", "0.5")
        assert state()["time"] == pytest.approx(900, abs=2)
        page.select_option(".speed", "100")
        assert state()["speed"] == 100
        eyes = []
        for name in ("overview", "side", "servicer", "target"):
            page.click(f"[data-camera={name}]")
            assert state()["camera"] == name
            eyes.append(tuple(np.round(state()["eye"], 3)))
        assert len(set(eyes)) == 4
        page.click("[data-frame=N]")
        assert state()["frame"] == "N"
        page.fill(".find", "servicer j_s")
        shown = page.query_selector_all("#parameters tbody tr:not(.gone)")
        assert [row.query_selector("code").inner_text() for row in shown] == ["servicer.J_S"]
        theme = page.evaluate("document.documentElement.dataset.theme")
        page.click("#theme")
        assert page.evaluate("document.documentElement.dataset.theme") != theme


def test_zoom_is_linked_and_a_click_seeks(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path) as page:
        page.query_selector("#plots .plot").scroll_into_view_if_needed()
        wait(page, "plotCards.filter(e => e.drawn).length > 2")
        page.evaluate(
            "Plotly.relayout(plotCards.find(e => e.plot.time && e.drawn).drawing,"
            " {'xaxis.range': [100, 250]})"
        )
        scroll_through(page)
        ranges = page.evaluate(
            "plotCards.filter(e => e.plot.time).map(e => e.drawing._fullLayout.xaxis.range)"
        )
        assert len(ranges) > 30
        assert all(span == [100, 250] for span in ranges)
        page.query_selector("#plots .plot").scroll_into_view_if_needed()
        page.evaluate(
            "plotCards.find(e => e.plot.time && e.visible).drawing"
            ".emit('plotly_click', {points: [{x: 123}]})"
        )
        assert page.evaluate("report.replay.state().time") == 123


def test_a_finger_finds_no_bar_of_buttons_over_a_plot(chromium, report_of):
    """Where nothing hovers it would cover the legend for good."""
    path, _ = report_of(SYSTEM)
    with opened(chromium, path, width=390, height=844, touch=True) as page:
        scroll_through(page)
        assert page.evaluate("document.querySelectorAll('.modebar-btn').length") == 0
    with opened(chromium, path) as page:
        scroll_through(page)
        assert page.evaluate("document.querySelectorAll('.modebar-btn').length") > 0


def test_names_with_an_index_are_symbols(chromium, report_of):
    path, _ = report_of("relay_approach")
    with opened(chromium, path) as page:
        scroll_through(page)
        required = {
            "rho_ref [m]": "\u03c1<sub>ref</sub> [m]",
            "omega of S": "\u03c9 of S",
            "guidance.rho_ref_N": "guidance.rho_ref_N",
            "a < b": "a &lt; b",
        }
        for text, html in required.items():
            assert page.evaluate("text => Symbols.html(text)", text) == html
        titles = page.evaluate(
            """[...document.querySelectorAll('.xtitle, .ytitle, .plot h4 span')]
                .map(e => e.textContent.replace(/\u200b/g, ''))"""
        )
        assert not [title for title in titles if "x_N" in title or "y_N" in title]
        assert {"xN [m]", "yN [m]"} <= set(titles)


def test_names_of_rings_do_not_cover_each_other(chromium, report_of):
    path, _ = report_of("relay_approach")
    with opened(chromium, path, width=390, height=844) as page:
        for time in (0, 3000, 6000):
            page.evaluate(f"report.replay.seek({time})")
            frame_of(page)
            places = page.evaluate(
                """[...document.querySelectorAll('.names > *')]
                    .filter(e => e.style.display === 'block' && / k?m$/.test(e.textContent))
                    .map(e => e.getBoundingClientRect())
                    .map(r => [r.x + r.width / 2, r.y + r.height / 2])"""
            )
            for k, (x, y) in enumerate(places):
                assert all(abs(x - a) > 40 or abs(y - b) > 12 for a, b in places[:k])


def test_a_phone_shows_the_page_without_scrolling_sideways(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path, width=390, height=844) as page:
        scroll_through(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        stage = page.query_selector(".stage").bounding_box()
        assert stage["width"] <= 390
        assert page.is_visible(".play")
