"""The documentation builds without a warning, and every link in it leads somewhere."""

import os
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urlsplit

import pytest
from calls import call_python
from reporting.browser import launch_browser

from wearscope import plugins
from wearscope.effects.base import load_effect

ROOT = Path(__file__).parents[2]


class Page(HTMLParser):
    """Links, anchors and text of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.loaded: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.anchors |= {named[key] for key in ("id", "name") if named.get(key)}
        if tag == "a" and named.get("href"):
            self.links.append(named["href"])
        if tag in ("img", "script", "link") and (target := named.get("src") or named.get("href")):
            self.loaded.append(target)

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site: pages by path."""
    target = tmp_path_factory.mktemp("site")
    words = ("-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", target)
    run = call_python(*words, folder=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "true"})
    assert run.returncode == 0 and "WARNING" not in run.stderr, run.stdout + run.stderr
    return {path: Page(path.read_text(encoding="utf-8")) for path in target.rglob("*.html")}


def broken(site):
    """Links to files or anchors that are not there."""
    lost = []
    for path, page in site.items():
        if path.name == "404.html":
            continue
        for link in [*page.links, *page.loaded]:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target = target / "index.html"
            anchor = unquote(parts.fragment)
            if not target.is_file():
                lost.append(f"{path.name}: {link}")
            elif anchor and target in site and anchor not in site[target].anchors:
                lost.append(f"{path.name}: {link}")
    return lost


def test_every_link_leads_somewhere(site):
    assert sum(len(page.links) for page in site.values()) > 500
    assert broken(site) == []


def test_a_broken_link_would_be_found(site):
    path = find(site, "limits.html")
    links = ("theory.html#nowhere", "nothing.html", "theory.html")
    page = Page("".join(f'<a href="{link}">there</a>' for link in links))
    assert broken({**site, path: page}) == [f"limits.html: {link}" for link in links[:2]]


def test_nothing_is_loaded_from_elsewhere(site):
    assert [one for page in site.values() for one in page.loaded if urlsplit(one).netloc] == []


def find(site, name):
    """Path of the page of a file's name."""
    return next(path for path in site if path.name == name)


def test_every_effect_and_detector_has_its_section(site):
    effects = plugins.list_names("effects", "EFFECT")
    page = site[find(site, "effects.html")]
    text = " ".join(page.words)
    assert set(effects) <= page.anchors
    for name in effects:
        assert load_effect(name).form in text and load_effect(name).source in text
    detectors = site[find(site, "built-in-detectors.html")]
    assert set(plugins.list_names("detectors", "DETECTOR")) <= detectors.anchors


def test_every_effect_and_detector_has_its_picture(site):
    for page, room, attribute in (
        ("effects.html", "effects", "EFFECT"), ("built-in-detectors.html", "detectors", "DETECTOR"),
    ):  # fmt: skip
        path = find(site, page)
        shown = {one for one in site[path].loaded if one.startswith(f"pictures/{room}/")}
        assert shown == {f"pictures/{room}/{name}.svg" for name in plugins.list_names(room, attribute)}
        for one in shown:
            text = (path.parent / one).read_text(encoding="utf-8")
            assert text.startswith("<?xml") and text.count("<path") > 5, one


def test_mathematics_is_shown_as_such(site):
    for path, page in site.items():
        text = " ".join(page.words)
        assert not any(sign in text for sign in (":math:", ".. math::", r"\frac", "$$")), path.name


@pytest.fixture(scope="module")
def browser():
    """A headless browser, where there is one."""
    with launch_browser() as opened:
        yield opened


@pytest.mark.parametrize("name", ["index", "tutorial", "gallery", "closed-loop", "torque-column"])
def test_pages_fit_a_phone_and_show_their_pictures_when_opened_as_files(site, browser, name):
    path = find(site, f"{name}.html")
    page = browser.new_page(viewport={"width": 390, "height": 800})
    page.goto(path.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    # Pictures are loaded as they come into view.
    script = "[...document.images].map(one => (one.loading = 'eager', one.decode().then(() => 1, () => 0)))"
    assert all(page.evaluate(f"Promise.all({script})"))
    page.close()


def test_the_search_finds_a_word_when_the_site_is_served(site, browser):
    handler = partial(QuietHandler, directory=str(find(site, "index.html").parent))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=server.serve_forever, daemon=True).start()
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    try:
        page.goto(f"http://127.0.0.1:{server.server_port}/index.html")
        page.locator("input.md-search__input").focus()
        page.keyboard.type("counterbalance")
        page.wait_for_selector(".md-search-result__item", state="attached", timeout=30_000)
        assert "effects.html" in page.locator(".md-search-result__link").first.get_attribute("href")
    finally:
        page.close()
        server.shutdown()
        server.server_close()


class QuietHandler(SimpleHTTPRequestHandler):
    """Serves files without a word."""

    def log_message(self, *_):
        pass
