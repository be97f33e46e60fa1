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


@contextmanager
def opened(running, path, width=1280, height=900, where="", touch=False):
    """A page of a file, at a place of it, ready; whatever goes wrong in it fails the test."""
    context = running.new_context(
        viewport={"width": width, "height": height},
        reduced_motion="reduce",
        offline=True,
        has_touch=touch,
    )
    page, wrong = context.new_page(), []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type != "log" else None)
    page.on("requestfailed", lambda request: wrong.append(f"wants {request.url[:100]}"))
    page.goto(path.absolute().as_uri() + where)
    page.wait_for_function("window.report && window.report.ready", timeout=120_000)
    yield page
    page.wait_for_timeout(50)
    assert wrong == []
    context.close()
