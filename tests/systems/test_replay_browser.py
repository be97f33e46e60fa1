# SPDX-License-Identifier: BSD-2-Clause
"""The replay in a browser: every control does what its label states, zones are where the target is
and red while violated, cameras show what their names promise. Run by make test-browser.
"""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from harness import run
from harness.api import write_page
from ssp.shared.exchange.bodies import instants, shadow, sun_direction
from ssp.shared.safety import RESTING
from tests.harness.chromium import opened, wait

RUNS = {
    "sync_approach": {"every": 10, "epoch": "2026-03-20T06:00:00"},
    "sync_approach_thrusters": {"stop": 60.0},
    "sync_approach_navigated": {"stop": 60.0},
    "relay_approach": {"stop": 4000.0, "every": 10},
    "relay_approach_navigated": {"stop": 300.0, "every": 10},
    "ppc_tracking": {"stop": 60.0},
    "ppc_tracking_navigated": {"stop": 30.0},
    "arch_rendezvous": {"every": 100},
    "servicing_mission": {"stop": 30.0},
    "arm_capture": {"stop": 30.0},
}
PLANNED = {"params": "limited", "swap": {"controller": "optimal_controller"}, "stop": 20.0}
SYSTEM, CAMERA = "sync_approach", "sync_approach_navigated"
PLAIN = "ppc_tracking"
FAR = 8.0
"""Range from which on the sizes of the bodies do not matter [m]."""
pytestmark = pytest.mark.browser
each_system = pytest.mark.parametrize("system", RUNS)


def state_at(page, time=None):
    if time is not None:
        page.evaluate(f"report.replay.seek({time})")
    return page.evaluate("report.replay.state()")


def times_of(result, count):
    return np.linspace(result.time[0], result.time[-1], count)


def picture_of(page):
    """The composed picture as an array (height, width, 3)."""
    data = page.evaluate("report.replay.compose(false).toDataURL('image/png').split(',')[1]")
    return pixels(base64.b64decode(data))


def pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)


# ---- zones


@each_system
def test_the_zone_is_about_the_target_at_three_instants(chromium, report_of, system):
    """In inertial axes; the origin of the scene is the target in orbit, the origin of N
    elsewhere.
    """
    path, result = report_of(system)
    target = result["target.r_TN_N"]
    orbit = np.linalg.norm(target[0]) > 1e6
    with opened(chromium, path) as page:
        page.click("[data-frame=N]")
        for part in (0.1, 0.5, 0.9):
            time = result.time[int(part * (len(result.time) - 1))]
            shown = state_at(page, time)["zones"]
            zones = [m for m in shown if m["kind"] in {"ellipsoid", "cuboid"}]
            expected = [0 if orbit else np.interp(time, result.time, axis) for axis in target.T]
            assert len(zones) == 1
            np.testing.assert_allclose(zones[0]["position"], expected, atol=1e-2)
            if result.holds(parameters=("monitor.keep_out_half",)):
                half = result.parameter("monitor.keep_out_half")
                np.testing.assert_allclose(zones[0]["size"], half, rtol=1e-5)


def test_a_zone_is_red_while_its_rule_is_violated_and_at_no_other_time(chromium, report_of):
    path, result = report_of(CAMERA)
    margin = result["monitor.corridor_margin"]
    assert (margin < 0).any()
    assert (margin >= 0).any()
    with opened(chromium, path) as page:
        for k in range(5, len(margin) - 5, len(margin) // 12):
            if len(set(margin[k - 5 : k + 5] < 0)) > 1:
                continue  # between two instants of the replay
            seen = state_at(page, result.time[k])
            (cone,) = (m for m in seen["zones"] if m["kind"] == "cone")
            assert cone["now"] == (2 if margin[k] < 0 else 0 if margin[k] >= RESTING else 1)
            assert (seen["rules"]["corridor"] == "violated") == bool(margin[k] < 0)


def test_words_and_values_are_in_the_picture_and_the_parameter_in_the_tool_tip(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path) as page:
        (zone,) = page.query_selector_all(".key div:has-text('keep-out')")
        assert zone.inner_text() == "keep-out zone, 4 m"
        assert zone.get_attribute("title").startswith("monitor.keep_out_half: ")
        text = page.inner_text(".stage")
        assert not [word for word in text.split() if "_" in word or "$" in word]


OVERLAPS = """() => {
    const boxes = [...document.querySelectorAll(".names .label")].map((e) =>
        ({ text: e.textContent, box: e.getBoundingClientRect() })).filter(({ box }) => box.width);
    const inside = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
        && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
    return boxes.flatMap((one, k) => boxes.slice(k + 1).filter((other) =>
        inside(one.box, other.box)).map((other) => `${one.text} on ${other.text}`));
}"""


@each_system
def test_no_name_overlaps_another_one(chromium, report_of, system):
    path, result = report_of(system)
    with opened(chromium, path) as page:
        cameras = page.query_selector_all(".cameras button")
        for camera in cameras:
            camera.click()
            for time in times_of(result, 5):
                page.evaluate(f"report.replay.seek({time})")
                page.wait_for_timeout(100)
                assert page.evaluate(OVERLAPS) == [], (camera.inner_text(), time)
        cameras[0].click()
        wait(page, "[...document.querySelectorAll('.names .label')].filter(e => e.offsetWidth)[1]")


# ---- time


def test_events_on_the_slider_seek_and_name_what_happened(chromium, report_of):
    path, result = report_of(SYSTEM)
    with opened(chromium, path) as page:
        events = page.query_selector_all(".event")
        titles = [event.get_attribute("title") for event in events]
        assert len(events) == len(page.evaluate("report.data.scene.events"))
        assert any("attitude control on" in title for title in titles)
        assert any("worst" in title for title in titles)
        assert any("shadow" in title for title in titles)
        for event in events:
            event.evaluate("event => event.click()")
            assert state_at(page)["time"] == float(event.get_attribute("data-time"))
        released = result.parameter("servicer.t_att")
        assert state_at(page, released - 1)["phase"] == "attitude frozen"
        assert state_at(page, released + 1)["phase"] == "attitude tracked"


def test_the_address_holds_the_instant(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path, where="#t=1547") as page:
        assert state_at(page)["time"] == 1547
        state_at(page, 321.5)
        wait(page, "location.hash === '#t=321.5'")
        page.evaluate("location.hash = '#t=900'")
        wait(page, "report.replay.state().time === 900")
        page.evaluate("location.hash = '#plots'")
        page.wait_for_timeout(50)
        assert state_at(page)["time"] == 900


def test_a_click_in_a_plot_leads_to_the_scene_and_a_button_back(chromium, report_of):
    path, _ = report_of(PLAIN)
    with opened(chromium, path) as page:
        page.query_selector("#plots .plot").scroll_into_view_if_needed()
        wait(page, "plotCards.some(e => e.drawn && e.visible && e.plot.time)")
        page.evaluate(
            "plotCards.find(e => e.plot.time && e.visible).drawing"
            ".emit('plotly_click', {points: [{x: 12.5}]})"
        )
        assert state_at(page)["time"] == 12.5
        wait(page, "document.querySelector('.stage').getBoundingClientRect().top >= 0")
        page.click(".return")
        wait(page, "scrollY > 300")
        assert not page.is_visible(".return")


def test_steps_keys_and_speeds(chromium, report_of):
    path, result = report_of(PLAIN)
    span = result.time[-1] - result.time[0]
    with opened(chromium, path) as page:
        steps = page.evaluate("Array.from(report.array(report.data.scene.time))")
        assert state_at(page)["speed"] == pytest.approx(span / 30)
        state_at(page, steps[7])
        for control, expected in ((".ahead", 8), (".ahead", 9), (".back", 8)):
            page.click(control)
            assert state_at(page)["time"] == steps[expected]
        page.focus(".stage canvas")
        for key, expected in ((".", 9), (",", 8), ("End", -1), ("Home", 0)):
            page.keyboard.press(key)
            assert state_at(page)["time"] == steps[expected]
        page.keyboard.press("ArrowRight")
        assert state_at(page)["time"] == pytest.approx(0.01 * span)
        page.keyboard.press("c")
        assert state_at(page)["camera"] == "side"
        page.keyboard.press("h")
        assert state_at(page)["frame"] == "N"
        page.keyboard.press(" ")
        assert state_at(page)["playing"]
        page.keyboard.press(" ")
        events = sorted({e["time"] for e in page.evaluate("report.data.scene.events")})
        page.keyboard.press("Home")
        seen = []
        for _ in range(2):
            page.click(".later")
            seen.append(state_at(page)["time"])
        later = [time for time in [*events, steps[-1], steps[-1]] if time > steps[0]]
        assert seen == later[:2]
        page.click(".earlier")
        assert state_at(page)["time"] < seen[1]


def test_another_table_can_be_shown_in_the_same_page(chromium, report_of):
    """The same data with the servicer elsewhere: scene and plots are made anew, old ones go."""
    path, _ = report_of(PLAIN)
    with opened(chromium, path) as page:
        before = state_at(page, 10)["bodies"]["servicer"]["position"]
        cards = page.evaluate("document.querySelectorAll('.plot').length")
        page.evaluate(
            """() => {
                const stored = JSON.parse(document.getElementById('arrays').textContent);
                const name = report.data.scene.bodies[0].r, r = report.array(name);
                stored[name] = {shape: r.shape, data: r.map(x => 2 * x)};
                report.present(report.data, stored); }"""
        )
        after = state_at(page, 10)["bodies"]["servicer"]["position"]
        np.testing.assert_allclose(after, 2 * np.array(before), rtol=1e-5)
        assert page.evaluate("document.querySelectorAll('.plot').length") == cards
        page.click(".ahead")
        assert not state_at(page)["playing"]


# ---- cameras


@pytest.mark.parametrize("system", [SYSTEM, "relay_approach", "arch_rendezvous"])
def test_the_overview_has_both_bodies_a_third_of_the_picture_apart(chromium, report_of, system):
    path, result = report_of(system)
    ranges = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
    with opened(chromium, path) as page:
        for time in times_of(result, 15):
            seen = state_at(page, time)
            places = [seen["bodies"][name]["screen"] for name in ("servicer", "target")]
            shares = np.array([[p["x"] / seen["width"], p["y"] / seen["height"]] for p in places])
            assert np.all((shares > 0.1) & (shares < 0.9))
            assert np.abs(shares[0] - shares[1]).max() < 0.34
            apart = np.interp(time, result.time, ranges)
            if apart > FAR:
                assert np.abs(shares[0] - shares[1]).max() == pytest.approx(1 / 3, abs=0.01)


@pytest.mark.parametrize("system", [SYSTEM, "relay_approach", "arm_capture"])
def test_nothing_is_between_a_camera_and_its_target(chromium, report_of, system):
    path, result = report_of(system)
    with opened(chromium, path) as page:
        for camera, seen in (("servicer", "target"), ("target", "servicer")):
            page.click(f"[data-camera={camera}]")
            assert {state_at(page, time)["first"] for time in times_of(result, 9)} == {seen}


def test_the_sensor_view_is_in_the_camera_and_looks_along_its_axis(chromium, report_of):
    path, result = report_of(CAMERA)
    with opened(chromium, path) as page:
        page.click("[data-camera=sensor]")
        page.click("[data-frame=N]")
        seen = state_at(page, 20.0)
        assert not seen["bodies"]["servicer"]["shown"]
        row = int(np.searchsorted(result.time, 20.0))
        turn = Rotation.from_quat(np.array(result["servicer.q_SN"][row, [1, 2, 3, 0]]))
        place = turn.apply(np.array(result.parameter("pose_sensor.p_KS_S")))
        eye = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[row] + place
        np.testing.assert_allclose(seen["eye"], eye, atol=0.02)
        mounted = Rotation.from_quat(np.array(result.parameter("pose_sensor.q_KS"))[[1, 2, 3, 0]])
        axis = turn.apply(mounted.apply([1, 0, 0]))
        angle = np.arccos(-eye @ axis / np.linalg.norm(eye))
        style = "document.querySelector('.sight').style.getPropertyValue('--radius')"
        radius = float(page.evaluate(f"parseFloat({style})"))
        spot = seen["bodies"]["target"]["screen"]
        off = np.hypot(spot["x"] - seen["width"] / 2, spot["y"] - seen["height"] / 2)
        half = result.parameter("pose_sensor.fov")
        assert off == pytest.approx(radius * np.tan(angle) / np.tan(half), abs=3)
        page.click("[data-camera=overview]")
        assert state_at(page)["bodies"]["servicer"]["shown"]
        assert not page.is_visible(".sight")


def test_the_sun_is_where_the_date_states_and_darkness_where_the_shadow_is(chromium, report_of):
    path, result = report_of(SYSTEM)
    towards = sun_direction(instants(result, RUNS[SYSTEM]["epoch"]))
    dark = shadow(result["target.r_TN_N"], towards)
    assert dark.max() == 1
    assert dark.min() == 0
    with opened(chromium, path) as page:
        page.click("[data-frame=N]")
        for k in (10, int(dark.argmax()) + 5, len(dark) - 10):
            seen = state_at(page, result.time[k])
            np.testing.assert_allclose(seen["sun"], towards[k], atol=1e-4)
            assert seen["dark"] == pytest.approx(dark[k], abs=0.05)
            assert ("in the shadow" in page.inner_text(".numbers")) == bool(dark[k] > 0.5)


# ---- what leaves the page


def test_the_picture_is_saved_with_its_words(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path) as page:
        state_at(page, 400)
        with page.expect_download() as awaited:
            page.click(".picture")
        assert awaited.value.suggested_filename == "sync_approach_400s.png"
        found = pixels(awaited.value.path().read_bytes())
        stage = page.query_selector(".stage canvas").bounding_box()
        assert found.shape[:2] == (int(stage["height"]), int(stage["width"]))
        words = found[10:120, 10:260]
        assert (words.min(axis=2) > 200).sum() > 100
        state_at(page, 1500)
        assert np.abs(picture_of(page) - found).mean() > 1


def test_a_video_is_saved(chromium, report_of):
    path, result = report_of(PLAIN)
    with opened(chromium, path) as page:
        state_at(page, 0.8 * result.time[-1])
        page.evaluate(f"report.replay.speed({result.time[-1] / 2})")
        with page.expect_download(timeout=120_000) as awaited:
            page.click(".video")
        data = awaited.value.path().read_bytes()
        assert data[:4] == b"\x1aE\xdf\xa3" or data[4:8] == b"ftyp"
        assert len(data) > 1000
        assert not state_at(page)["recording"]


def test_the_printed_page_has_the_scene_and_all_plots_on_white(chromium, report_of):
    path, _ = report_of(PLAIN)
    with opened(chromium, path, width=794) as page:
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        page.emulate_media(media="print")
        assert page.is_visible(".printed")
        assert not page.is_visible(".stage")
        wait(page, "document.querySelector('.printed').naturalWidth > 300")
        drawn = page.evaluate("plotCards.filter(e => e.made.offsetParent).map(e => e.drawn)")
        assert len(drawn) > 5
        assert all(drawn)
        corner = page.evaluate(
            """() => {
                const image = document.querySelector('.printed');
                const c = document.createElement('canvas');
                c.width = image.naturalWidth; c.height = image.naturalHeight;
                const pen = c.getContext('2d'); pen.drawImage(image, 0, 0);
                return Array.from(pen.getImageData(c.width - 3, 3, 1, 1).data); }"""
        )
        assert corner == [255, 255, 255, 255]
        assert page.evaluate("document.documentElement.dataset.theme") == "light"
        wider = """plotCards.filter(e => e.made.offsetParent &&
            e.drawing.querySelector('.main-svg').getBoundingClientRect().right >
            e.made.getBoundingClientRect().right + 1).length"""
        assert page.evaluate(wider) == 0
        page.emulate_media(media="screen")
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        page.wait_for_timeout(500)
        assert page.evaluate(wider) == 0
        narrow = "plotCards.filter(e => e.visible && e.made.clientWidth < 400).length"
        assert page.evaluate(narrow) == 0


# ---- fingers, narrow screens


def test_a_phone_has_all_controls_within_reach_of_a_finger(chromium, report_of):
    path, _ = report_of(SYSTEM)
    with opened(chromium, path, width=390, height=844, touch=True) as page:
        stage = page.query_selector(".stage").bounding_box()
        for name in (".play", ".back", ".ahead", ".speed", ".picture", ".full"):
            box = page.query_selector(name).bounding_box()
            assert stage["x"] <= box["x"]
            assert box["x"] + box["width"] <= stage["x"] + stage["width"]
            assert box["y"] + box["height"] <= stage["y"] + stage["height"]
            assert box["height"] >= 32
        page.tap(".play")
        assert state_at(page)["playing"]
        page.tap(".play")
        page.tap("[data-camera=target]")
        assert state_at(page)["camera"] == "target"
        assert page.evaluate("document.documentElement.scrollWidth") <= 390


# ---- the planned path


def test_the_planned_path_leads_ahead_of_the_servicer(chromium, tmp_path):
    """None before the first plan, then from the servicer through the points of the row."""
    result = run(SYSTEM, **PLANNED)
    with opened(chromium, write_page(result, tmp_path / "page.html")) as page:
        page.click("[data-frame=N]")
        assert not state_at(page, 0.5)["plans"][0]["shown"]
        assert "planned path" in page.inner_text(".key")
        for time in (5.0, 15.0):
            (plan,) = state_at(page, time)["plans"]
            row = np.searchsorted(result.time, time - 1e-6)
            rho = result["servicer.r_SN_N"][row] - result["target.r_TN_N"][row]
            expected = np.vstack([rho, result["controller.plan_rho_N"][row]])
            assert plan["shown"] and plan["colour"] == "#f5f7fa"
            np.testing.assert_allclose(np.reshape(plan["points"], (7, 3)), expected, atol=1e-2)
            np.testing.assert_allclose(plan["position"], 0, atol=1e-6)
        page.evaluate("document.querySelector('[name=plans]').click()")
        assert not state_at(page)["plans"][0]["shown"]
