# SPDX-License-Identifier: BSD-2-Clause
"""Pages at the widths of a phone, a tablet and a screen, light and dark, and printed: by the boxes
of the layout no text is cut, no label covers another one, nothing scrolls sideways. Run by
make test-browser.
"""

from __future__ import annotations

import pytest

from harness import campaign, compare
from harness.api import write_page
from tests.harness.chromium import opened

RUNS = {
    "sync_approach": {"every": 10, "params": "clear"},
    "relay_approach": {"stop": 4000.0},
    "servicing_mission": {"params": "ground_retreat", "every": 100},
}
SIZES = {"phone": (390, 844), "tablet": (800, 1000), "screen": (1440, 900)}
each_size = pytest.mark.parametrize("size", SIZES)
pytestmark = pytest.mark.browser

DRAWN = """() => new Promise((done) =>
    requestAnimationFrame(() => requestAnimationFrame(done)))"""
"""Wait until the replay has drawn its present instant."""
COVERED = """() => {
    const stage = document.querySelector(".stage"), frame = stage.getBoundingClientRect();
    const all = [...stage.querySelectorAll(
        ".names .label, .readout > *, .cameras button, .key div, .controls button,"
        + ".controls select, .controls output, .controls summary, .triad text")];
    const seen = all.filter((e) => e.textContent.trim() && getComputedStyle(e).display !== "none"
        && !e.closest(".gone") && !e.closest(".events") && e.getClientRects().length);
    const boxes = seen.map((e) => {
        const range = document.createRange();
        range.selectNodeContents(e);
        const box = (e.matches("button, select") ? e : range).getBoundingClientRect();
        return { text: e.textContent.trim().slice(0, 30), box };
    });
    const found = boxes.filter(({ box }) => box.left < frame.left - 1 || box.top < frame.top - 1
        || box.right > frame.right + 1 || box.bottom > frame.bottom + 1)
        .map((x) => `${x.text} is cut by the edge`);
    boxes.forEach((x, k) => boxes.slice(0, k).forEach((y) => {
        const wide = Math.min(x.box.right, y.box.right) - Math.max(x.box.left, y.box.left);
        const high = Math.min(x.box.bottom, y.box.bottom) - Math.max(x.box.top, y.box.top);
        if (wide > 1.5 && high > 3) found.push(`${x.text} covers ${y.text}`);
    }));
    return found;
}"""
"""Texts of the replay that leave its frame or cover each other."""
CUT = """() => {
    const found = [], wide = document.documentElement.clientWidth;
    const other = ".stage, .js-plotly-plot, script, svg, .printed, select";
    for (const e of document.querySelectorAll("main *, header *, footer *")) {
        if (e.closest(other) || !e.getClientRects().length) continue;
        if (![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim())) continue;
        const box = e.getBoundingClientRect(), text = e.textContent.trim().slice(0, 40);
        for (const n of e.childNodes) {
            if (n.nodeType !== 3) continue;
            const range = document.createRange();
            range.selectNodeContents(n);
            const lines = new Set([...range.getClientRects()].map((line) => Math.round(line.top)));
            if (lines.size > 2 && n.data.trim().length < 4 * lines.size)
                found.push(`${text} is squeezed`);
        }
        const hides = getComputedStyle(e).overflowX !== "visible";
        if (hides && e.scrollWidth > e.clientWidth + 1) found.push(`${text} is cut`);
        if (!e.closest(".scroll") && (box.right > wide + 1 || box.left < -1))
            found.push(`${text} leaves the page`);
    }
    if (document.documentElement.scrollWidth > wide) found.push("the page scrolls sideways");
    return found;
}"""
"""Texts of the page that are cut or leave it."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory, report_of):
    """Paths of a page of each kind."""
    folder = tmp_path_factory.mktemp("pages")
    table = {
        "system": "sync_approach",
        "runs": 12,
        "seed": 1,
        "fixed": {"params": "clear", "stop": 60.0},
        "factors": {"servicer.mass_0": {"uniform": {"low": 90.0, "high": 110.0}}},
        "metrics": {"cost": "delta-v"},
        "success": "parameter(servicer.mass_0) < 100 and last(guidance.range) < 19.5 m",
    }
    masses = {"servicer.mass_0": [90.0, 110.0]}
    compare("sync_approach", folder / "runs", vary=masses, params=["clear"], stop=100.0)
    campaign(table, folder / "c.zarr")
    return {
        "run": report_of("sync_approach")[0],
        "other run": report_of("relay_approach")[0],
        "run that retreats": report_of("servicing_mission")[0],
        "comparison": write_page(folder / "runs", folder / "comparison.html"),
        "campaign": write_page(folder / "c.zarr", folder / "campaign.html"),
    }


@each_size
def test_labels_of_the_replay_neither_cover_each_other_nor_are_cut(chromium, report_of, size):
    width, height = SIZES[size]
    for system in RUNS:
        path, result = report_of(system)
        with opened(chromium, path, width=width, height=height) as page:
            page.query_selector(".stage").scroll_into_view_if_needed()
            found = set()
            for camera in page.eval_on_selector_all(
                "[data-camera]", "all => all.map(each => each.dataset.camera)"
            ):
                page.click(f"[data-camera={camera}]")
                for share in (0.0, 0.2, 0.45, 0.7, 1.0):
                    page.evaluate(f"report.replay.seek({share * result.time[-1]})")
                    page.evaluate(DRAWN)
                    found |= {f"{camera} {share}: {each}" for each in page.evaluate(COVERED)}
            assert sorted(found) == [], system


@pytest.mark.parametrize("theme", ["light", "dark"])
@each_size
def test_no_text_of_a_page_is_cut_and_nothing_scrolls_sideways(chromium, pages, size, theme):
    width, height = SIZES[size]
    for kind, path in pages.items():
        with opened(chromium, path, width=width, height=height) as page:
            if page.evaluate("document.documentElement.dataset.theme") != theme:
                page.click("#theme")
            assert page.evaluate(CUT) == [], kind


def test_a_printed_page_is_complete_on_its_paper(chromium, pages):
    """A4 at 96 dots per inch, without margins: 794 dots wide."""
    for kind, path in pages.items():
        with opened(chromium, path, width=794, height=1123) as page:
            page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
            page.emulate_media(media="print")
            page.wait_for_timeout(300)
            assert page.evaluate(CUT) == [], kind
            assert not page.is_visible(".stage"), kind
            page.emulate_media(media="screen")


def test_headline_values_are_explained_on_hover_and_on_focus(chromium, report_of):
    path, _ = report_of("sync_approach")
    shown = "e => getComputedStyle(e, '::after').content"
    with opened(chromium, path) as page:
        tiles = page.query_selector_all("#numbers .tile")
        assert len(tiles) >= 8
        for tile in tiles:
            about = tile.get_attribute("data-about")
            assert about.endswith("."), tile.inner_text()
            assert tile.evaluate(shown) == "none"
            tile.focus()
            assert about in tile.evaluate(shown)
        tiles[0].hover()
        assert tiles[0].get_attribute("data-about") in tiles[0].evaluate(shown)
