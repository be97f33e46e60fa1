# SPDX-License-Identifier: BSD-2-Clause
"""The page that simulates in a browser, alone and without a network: the bits of the file, the
verdicts of the harness for drawn settings, keyboard, cancel, and a browser that cannot. Run by make
test-browser.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from harness import run
from harness.api import write_page
from harness.report.run import metrics
from harness.results.requirements import findings
from tests.harness.chromium import opened, wait
from tests.harness.report_page import Page

pytestmark = pytest.mark.browser

SYSTEM = "sync_approach"
LARGEST = 6_000_000
"""Bytes of a page."""
DRAWS = 10
OF_FUNCTIONS = {"attitude_error", "trajectory", "force", "safety_margins"}
"""Figures with curves that Python functions compute."""
LABELLED = """report.data.figures.flatMap(part => part.figures).filter(figure => figure.plots.some(
    plot => [plot.title, ...plot.curves.map(curve => curve.name)].some(
        text => text.endsWith("(of the run in the file)")))).map(figure => figure.name)"""
PHASES = ["attitude frozen", "attitude tracked"]


@pytest.fixture(scope="module")
def result():
    return run(SYSTEM)


@pytest.fixture(scope="module")
def path(tmp_path_factory, result):
    pytest.importorskip("ziglang", reason="needs ziglang: make test-browser installs it")
    return write_page(result, tmp_path_factory.mktemp("live") / "page.html", live=True)


def ready(page):
    wait(page, "report.live && report.live.ready")


def simulated(page, settings):
    """Verdicts and end of a run with these settings."""
    page.evaluate("settings => report.live.run(settings)", settings)
    return page.evaluate("report.live")


def headline(result):
    """Texts of the headline values of a run by name."""
    return {m.name: f"{value:.4g} {m.unit}" for m, value in metrics(result) if np.isfinite(value)}


def stated(verdicts):
    return [(v["name"], v["verdict"], v["detail"]) for v in verdicts]


def required(result):
    return [(f.name, f.statement.split(",")[0], f.detail) for f in findings(result)]


def test_the_page_is_small_and_has_the_bits_of_the_file(chromium, path, result):
    assert Page(path.read_text(encoding="utf-8")).is_closed("'wasm-unsafe-eval'")
    assert path.stat().st_size <= LARGEST
    sha256 = hashlib.sha256(np.ascontiguousarray(result.values).tobytes()).hexdigest()
    with opened(chromium, path) as page:
        ready(page)
        assert page.get_attribute("#live .bits", "data-sha256") == sha256
        assert page.inner_text("#live .bits").startswith("Bits of this page = bits of the file")
        assert stated(page.evaluate("report.live.verdicts")) == required(result)


def test_verdicts_of_drawn_settings_match_the_harness(chromium, path):
    draw = np.random.default_rng(25)
    with opened(chromium, path) as page:
        ready(page)
        sliders = page.evaluate("report.live.sliders")
        names = page.eval_on_selector_all(
            "#live .slider code", "all => all.map(e => e.textContent)"
        )
        verdicts = set()
        for _ in range(DRAWS):
            settings = [float(draw.uniform(s["low"], s["high"])) for s in sliders]
            other = run(SYSTEM, set=dict(zip(names, settings, strict=True)))
            live = simulated(page, settings)
            assert stated(live["verdicts"]) == required(other)
            assert live["result"]["complete"]
            verdicts |= {(name, verdict) for name, verdict, _ in stated(live["verdicts"])}
        assert len(verdicts) > len(live["verdicts"])  # the settings matter


def test_a_key_on_a_slider_changes_verdicts_replay_and_plots(chromium, path):
    with opened(chromium, path) as page:
        ready(page)
        page.evaluate("report.replay.seek(900)")
        before = page.evaluate("report.replay.state().bodies.servicer.position")
        table = page.inner_text("#requirements tbody")
        page.focus("#slider-3")
        page.keyboard.press("End")
        page.evaluate("report.live.idle()")
        assert page.evaluate("report.live.settings")[2] == 0.02
        page.evaluate("report.replay.seek(900)")
        assert page.evaluate("report.replay.state().bodies.servicer.position") != before
        assert page.inner_text("#requirements tbody") != table
        assert page.is_visible("#live .stale")
        assert set(page.evaluate(LABELLED)) == OF_FUNCTIONS
        assert "of-file" in page.get_attribute("#claims", "class")
        time_of = {e["text"]: e["time"] for e in page.evaluate("report.data.scene.events")}
        for verdict in page.evaluate("report.live.verdicts"):
            (mark,) = (text for text in time_of if text.startswith(f"{verdict['name']}: "))
            assert verdict["detail"] in mark
            assert time_of[mark] == verdict["time"]
        assert time_of["attitude control on"] == 1200
        assert page.evaluate("report.data.scene.phases.map(p => p.text)") == PHASES
        assert page.evaluate("document.querySelectorAll('.event').length") == len(time_of)
        page.click("#live .reset")
        page.evaluate("report.live.idle()")
        assert "=" in page.inner_text("#live .bits")
        page.evaluate("report.replay.seek(900)")
        after = page.evaluate("report.replay.state().bodies.servicer.position")
        np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6)
        assert page.inner_text("#requirements tbody") == table


def shown(page):
    """Texts of the headline values by name; those marked as values of the file are left out."""
    return dict(
        page.eval_on_selector_all(
            "#numbers .tile:not([hidden]):not(.of-file)",
            "all => all.map(e => ['span', 'b'].map(part => e.querySelector(part).textContent))",
        )
    )


def test_headline_values_follow_a_slider(chromium, path, result):
    """They equal the values of `harness run --set`."""
    with opened(chromium, path) as page:
        ready(page)
        before = shown(page)
        assert before == headline(result)
        page.focus("#slider-2")
        page.keyboard.press("End")
        page.evaluate("report.live.idle()")
        other = run(SYSTEM, set={"target.omega_TN_T_0[2]": 0.02})
        after = headline(other)
        assert shown(page) == after
        assert sum(before.get(name) != text for name, text in after.items()) >= 5
        tile = page.query_selector("#numbers .tile:has-text('minimum range')")
        assert after["minimum range"].split()[0] in tile.get_attribute("aria-label")
        page.click("#live .reset")
        page.evaluate("report.live.idle()")
        assert shown(page) == before


def test_a_headline_value_of_a_function_is_marked(chromium, path, tmp_path):
    other = write_page(run("relay_approach", every=10), tmp_path / "relay.html", live=True)
    with opened(chromium, other) as page:
        ready(page)
        assert page.query_selector_all("#numbers .tile.of-file") == []
        page.focus("#slider-1")
        page.keyboard.press("End")
        page.evaluate("report.live.idle()")
        (marked,) = page.query_selector_all("#numbers .tile.of-file")
        assert "x optimum" in marked.inner_text()
        assert "minimum range" in shown(page)


def test_a_value_beyond_the_range_stays_at_its_end(chromium, path):
    with opened(chromium, path) as page:
        ready(page)
        base = [s["base"] for s in page.evaluate("report.live.sliders")]
        live = simulated(page, [1e9, *base[1:]])  # beyond the range: the slider stays at its end
        assert live["settings"][0] == page.evaluate("report.live.sliders[0].high")
        assert simulated(page, base)["result"]["complete"]


def test_a_rejected_run_leaves_the_run_before_on_the_page(chromium, tmp_path):
    """A slider whose range contains values that the servicer rejects."""
    text = f'extends = "{SYSTEM}"\nname = "far"\n[live.sliders]\n"servicer.J_S[1,1]" = [1, 300]\n'
    (tmp_path / "far.toml").write_text(text)
    far = write_page(run(tmp_path / "far.toml", stop=60), tmp_path / "far.html", live=True)
    with opened(chromium, far) as page:
        ready(page)
        base = page.evaluate("report.live.sliders.map(s => s.base)")
        simulated(page, [90, *base[1:]])
        shown = [page.inner_html(part) for part in ("#numbers", "#requirements")]
        simulated(page, [90, *base[1:-1], 1])
        text = page.inner_text("#live .outcome")
        assert text.startswith("rejected, the page still shows the run before: ")
        assert [page.inner_html(part) for part in ("#numbers", "#requirements")] == shown


def test_no_button_of_a_plot_sends_it_to_a_server(chromium, path):
    with opened(chromium, path) as page:
        ready(page)
        page.locator("#plots").scroll_into_view_if_needed()
        page.wait_for_selector(".modebar-btn", state="attached")
        buttons = "[...document.querySelectorAll('.modebar-btn')]"
        titles = page.evaluate(f"{buttons}.map(b => b.dataset.title)")
        assert len(titles) > 3
        assert not [t for t in titles if re.search("share|cloud|chart studio", t, re.IGNORECASE)]


def test_a_run_is_cancelled_and_the_next_one_is_whole(chromium, path):
    with opened(chromium, path) as page:
        ready(page)
        base = [s["base"] for s in page.evaluate("report.live.sliders")]
        page.evaluate(
            """settings => { report.live.run(settings);
                             document.querySelector('#live .cancel').click(); }""",
            [base[0] + 1, *base[1:]],
        )
        page.evaluate("report.live.idle()")
        assert "cancelled" in page.inner_text("#live .outcome")
        assert simulated(page, base)["result"]["complete"]


def test_a_browser_without_webassembly_states_so_and_shows_the_report(chromium, path):
    context = chromium.new_context(offline=True)
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.add_init_script("delete globalThis.WebAssembly")
    page.goto(Path(path).absolute().as_uri())
    wait(page, "window.report && window.report.ready")
    assert "has no WebAssembly" in page.inner_text("#live .outcome")
    assert page.is_disabled("#slider-1") and wrong == []
    assert page.locator("#requirements tbody tr").count() == len(page.query_selector_all(".seek"))
    context.close()


def test_nothing_sticks_out_on_a_phone(chromium, path):
    with opened(chromium, path, width=360, height=740) as page:
        ready(page)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert page.locator("#slider-1").bounding_box()["height"] >= 32
