"""A headless browser for the tests of pages, where there is one."""

import shutil
from contextlib import contextmanager

import pandas as pd
import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")

#: Cells of tables whose text runs over their edge, as a script.
RUNNING_OVER = (
    "[...document.querySelectorAll('td')].filter(one => one.scrollWidth > one.clientWidth + 1)"
    ".map(one => one.textContent)"
)


def find_browser():
    """Path of a browser, or a skipped test that says why."""
    pytest.importorskip("playwright", reason="playwright is not installed")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the path")
    return path


@contextmanager
def launch_browser():
    """A headless browser for many pages."""
    path = find_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@contextmanager
def open_page(browser, file, width=1280, scheme="light"):
    """A page in a browser, once ready; what it complains of or loads is an error at the end."""
    complaints = []
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, accept_downloads=True
    )
    page = context.new_page()
    page.on("console", lambda one: one.type == "error" and complaints.append(one.text))
    page.on("pageerror", lambda one: complaints.append(str(one)))
    page.on(
        "request",
        lambda one: one.url.startswith(("file:", "data:", "blob:")) or complaints.append(one.url),
    )
    try:
        page.goto(file.as_uri())
        page.wait_for_selector("html[data-ready=yes]", timeout=60_000)
        yield page
    finally:
        context.close()
    assert complaints == []


def rows_of(page, chart, name=None):
    """Rows that a chart draws."""
    script = "([chart, name]) => wearscope.rows(chart, name ?? undefined)"
    return pd.DataFrame(page.evaluate(script, [chart, name]))
