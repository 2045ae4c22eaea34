"""What a code host shows of the documentation is what the site shows: written in, and without dead links."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
_LINK = re.compile(r"\]\(([^)#\s]+)")


def test_what_is_written_into_pages_is_what_the_code_makes(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    from written import list_pages

    stale = [str(page.relative_to(ROOT)) for page, text in list_pages() if page.read_text("utf-8") != text]
    assert not stale, "python docs/site/written.py"


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_no_link_of_a_page_is_dead_and_every_table_is_written_in(page):
    text = page.read_text(encoding="utf-8")
    links = [link for link in _LINK.findall(text) if not re.match(r"[a-z]+:", link)]
    assert [link for link in links if not (page.parent / link).exists()] == []
    assert "[[" not in re.sub(r"```.*?```|`[^`]*`", "", text, flags=re.DOTALL)
    assert not re.search(r"<!-- (table|value): \w+ --><!-- end -->", text)
