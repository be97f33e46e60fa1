# SPDX-License-Identifier: BSD-2-Clause
"""The built site in Chromium, opened as files and without a network: every page, every picture,
search, equations, light and dark, a phone. `make test-browser` builds the site first.
"""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.harness.chromium import browser, wait
from tests.site.questions import QUESTIONS

SITE = Path(__file__).resolve().parents[2] / "build/site"
PAGES = sorted(p for p in SITE.rglob("*.html") if p.name != "404.html")  # that one is for servers
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not PAGES, reason="needs the site: make site"),
]
NAVIGATION = "nav.md-nav--primary a.md-nav__link[href]"
WIDE = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


class Addresses(HTMLParser):
    """Addresses that a page loads or leads to."""

    def __init__(self):
        super().__init__()
        self.loaded, self.linked, self.places = [], [], set()

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        if "id" in given:
            self.places.add(given["id"])
        if tag in {"img", "script", "iframe", "source"} and given.get("src"):
            self.loaded.append(given["src"])
        if tag == "link" and given.get("rel") in {"stylesheet", "icon", "preload"}:
            self.loaded.append(given["href"])
        if tag == "a" and given.get("href"):
            self.linked.append(given["href"])


def addresses(page):
    parser = Addresses()
    parser.feed(page.read_text(encoding="utf-8"))
    return parser


GIVEN_UP = "net::ERR_ABORTED"
"""What a request ends with that its page has left behind, as one for an icon."""


@pytest.fixture(scope="module")
def chromium():
    with browser() as running:
        yield running


@pytest.fixture
def opened(chromium):
    """Opens pages of the site; any error in one fails the test."""
    context = chromium.new_context(offline=True, viewport={"width": 1280, "height": 900})
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(f"{page.url}: {error}"))
    page.on("console", lambda line: wrong.append(f"{page.url}: {line.text}"))
    page.on(
        "requestfailed",
        lambda request: (
            request.failure == GIVEN_UP or wrong.append(f"{page.url}: no {request.url[:150]}")
        ),
    )
    page.on(
        "request",
        lambda request: (
            request.url.startswith(("file:", "data:", "blob:", "about:"))
            or wrong.append(f"{page.url} requests {request.url[:150]}")
        ),
    )
    yield page
    assert wrong == []
    context.close()


def test_every_page_opens_without_error_request_or_missing_picture(opened):
    for path in PAGES:
        opened.goto(path.as_uri(), wait_until="load")
        missing = opened.evaluate(
            # one without an address is the frame of a picture that the page prints
            "[...document.images].filter(i => i.getAttribute('src'))"
            ".filter(i => i.complete && !i.naturalWidth).map(i => i.src)"
        )
        assert missing == [], path.name


def test_every_entry_of_the_navigation_opens_a_page(opened):
    opened.goto((SITE / "index.html").as_uri())
    entries = set(opened.eval_on_selector_all(NAVIGATION, "all => all.map(a => a.href)"))
    assert len(entries) > 100
    known = {path.as_uri() for path in PAGES}
    assert {entry.partition("#")[0] for entry in entries} <= known


def test_every_link_and_picture_leads_somewhere_and_nothing_is_loaded_from_elsewhere():
    known = {path: addresses(path) for path in PAGES}
    for path, found in known.items():
        for address in found.loaded:
            assert not re.match(r"(https?:)?//", address), f"{path.name} loads {address}"
        for address in [*found.loaded, *found.linked]:
            if re.match(r"[a-z]+:", address):
                continue
            file, _, place = address.partition("#")
            target = (path.parent / file.partition("?")[0]).resolve() if file else path
            assert target.exists(), f"{path.relative_to(SITE)}: {address}"
            if place and target in known and not place.startswith("__"):
                assert place in known[target].places, f"{path.relative_to(SITE)}: {address}"


def test_the_live_page_of_every_mission_repeats_its_run(opened):
    pages = sorted((SITE / "live").glob("*.html"))
    missions = {p.stem for p in (SITE / "reference/missions").glob("*.html")} - {"index"}
    assert {p.stem for p in pages if not p.stem.startswith("lesson_")} == missions
    for path in pages:
        opened.goto(path.as_uri())
        wait(opened, "window.report?.live?.ready")
        text = opened.inner_text("#live .bits")
        assert text.startswith("Bits of this page = bits of the file"), path.name


def test_search_finds_a_parameter_without_a_network(opened):
    opened.goto((SITE / "index.html").as_uri())
    opened.click("input.md-search__input")
    opened.keyboard.type("corridor", delay=20)
    opened.wait_for_selector(".md-search-result__item", timeout=30_000)
    found = opened.inner_text(".md-search-result__list")
    assert "safety_monitor" in found


def test_questions_in_peoples_words_find_their_page_among_the_first_three(opened):
    opened.goto((SITE / "index.html").as_uri())
    assert len(QUESTIONS) == 25
    missed = {}
    for question, page in QUESTIONS.items():
        opened.click("input.md-search__input")
        opened.keyboard.press("Control+a")
        opened.keyboard.type(question, delay=5)
        opened.wait_for_timeout(700)
        first = opened.eval_on_selector_all(
            ".md-search-result__item > a",
            "all => [...new Set(all.map(a => a.href.split(/[?#]/)[0]))].slice(0, 3)",
        )
        if not any(address.endswith(f"{page}.html") for address in first):
            missed[question] = [address.rpartition("/site/")[2] for address in first]
    assert missed == {}


def test_equations_are_drawn(opened):
    for name in ("notation", "reference/fmus/servicer", "reference/equations/sync_approach"):
        opened.goto((SITE / f"{name}.html").as_uri())
        opened.wait_for_selector("mjx-container svg", timeout=30_000)
        assert opened.locator("mjx-merror").count() == 0, name


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_follow_the_colours_of_the_system(chromium, scheme):
    context = chromium.new_context(offline=True, color_scheme=scheme)
    page = context.new_page()
    page.goto((SITE / "index.html").as_uri())
    page.wait_for_timeout(300)
    (red, green, blue) = re.findall(
        r"\d+", page.evaluate("getComputedStyle(document.body).backgroundColor")
    )[:3]
    assert (int(red) + int(green) + int(blue) > 500) == (scheme == "light")
    context.close()


def test_pages_fit_a_phone(chromium):
    context = chromium.new_context(offline=True, viewport={"width": 390, "height": 844})
    page = context.new_page()
    for name in ("index", "tutorial", "reference/fmus/servicer", "validation/jeod", "robustness"):
        page.goto((SITE / f"{name}.html").as_uri())
        assert page.evaluate(WIDE) <= 0, name
    context.close()
