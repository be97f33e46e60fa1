# SPDX-License-Identifier: BSD-2-Clause
"""A Chromium without a screen, from the system; without it, or Playwright, tests are skipped."""

from __future__ import annotations

import shutil
from contextlib import contextmanager

import pytest

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SWITCHES = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""No sandbox: as root there is none; WebGL without a graphics card."""


@contextmanager
def browser():
    """A running browser; skips the test where there is none."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="needs Playwright: make test-browser installs it"
    )
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip(f"needs Chromium: none of {', '.join(PROGRAMS)} is installed")
    with playwright.sync_playwright() as tool:
        running = tool.chromium.launch(executable_path=program, args=list(SWITCHES))
        yield running
        running.close()


def wait(page, condition, polls=2400):
    """Wait until an expression holds in a page; Playwright's own wait_for_function evaluates text
    in the page, which its policy forbids.
    """
    for _ in range(polls):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    pytest.fail(f"never holds: {condition}")


@contextmanager
def opened(running, path, width=1280, height=900, where="", touch=False):
    """A page of a file, at one of its places, ready; any error in the page fails the test."""
    context = running.new_context(
        viewport={"width": width, "height": height},
        reduced_motion="reduce",
        offline=True,
        has_touch=touch,
    )
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "console", lambda reported: wrong.append(reported.text) if reported.type != "log" else None
    )
    page.on("requestfailed", lambda request: wrong.append(f"requests {request.url[:100]}"))
    page.goto(path.absolute().as_uri() + where)
    wait(page, "window.report && window.report.ready")
    yield page
    page.wait_for_timeout(50)
    assert wrong == []
    context.close()
