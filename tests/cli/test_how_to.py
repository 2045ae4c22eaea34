"""Each how-to page and the tutorial, their commands run from an empty folder as they stand.

Commands that compute for minutes are planned only; the long tests run them.
"""

import os
import re
import sys
from pathlib import Path

import pytest
from calls import call

PAGES = sorted((Path(__file__).parents[2] / "docs" / "how-to").glob("*.md"))
PRINTED = [*PAGES, Path(__file__).parents[2] / "docs" / "tutorial.md"]
#: Pages whose commands take seconds where those that compute are planned only.
QUICK = ("factor", "notebook", "plugins", "study")
LONG = re.compile(r"^(wearscope (?:run|diagnose|track|detect|reevaluate|report)\b.*)$", re.MULTILINE)
#: A page is under a screen.
LINES = 60


def list_blocks(page: Path, language: str = "sh") -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


@pytest.fixture
def shell(tmp_path):
    """Run a block of a page, with the command as an installed one."""
    tools, folder = tmp_path / "bin", tmp_path / "empty"
    tools.mkdir()
    folder.mkdir()
    for name, module in (("wearscope", "wearscope"), ("pytest", "pytest -q -p no:cacheprovider")):
        (tools / name).write_text(f'#!/bin/sh\nexec {sys.executable} -m {module} "$@"\n')
        (tools / name).chmod(0o755)
    path = f"{tools}{os.pathsep}{os.environ['PATH']}"
    own = {"PATH": path, "HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}

    def run(block: str) -> str:
        shell = ("bash", "-euo", "pipefail", "-c", block)
        done = call(*shell, folder=folder, env=os.environ | own, timeout=1800)
        assert done.returncode == 0, f"{block}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
        return done.stdout

    return run


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=[] if p.stem in QUICK else pytest.mark.slow, id=p.stem) for p in PRINTED],
)
def test_page_s_commands_work(page, shell):
    for block in list_blocks(page):
        if "show " in block or "compare " in block:  # they need what a run gives
            continue
        shell(LONG.sub(r"\1 --dry-run --cores 1", block))


@pytest.mark.long
@pytest.mark.parametrize("page", PRINTED, ids=lambda page: page.stem)
def test_page_s_commands_compute(page, shell):
    for block in list_blocks(page):
        shell(block)
    if page.stem == "notebook":
        for block in list_blocks(page, "python"):
            shell(f"{sys.executable} - <<'END'\n{block}END\n")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_is_under_a_screen(page):
    assert len(page.read_text().splitlines()) <= LINES
    assert list_blocks(page), f"{page.name} has no commands"


def test_there_is_a_page_for_each_thing_to_bring():
    assert {"robot", "dataset", "cycle", "detector", "effect", "study"} <= {page.stem for page in PAGES}
