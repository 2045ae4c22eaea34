"""Which tests are slow, by the processor seconds that each one took; what pages and refusals say."""

import gc
import os
import re
from collections import defaultdict
from difflib import unified_diff
from html import escape, unescape
from itertools import count
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MEASURED = Path(__file__).with_name("processor_seconds.tsv")
#: A test from here on is slow [s of processor]. The cheapest of its function stays, up to `MOST`: it fails
#: for the same changes of the code.
SLOW, MOST = 1.0, 8.0


def read_seconds():
    """Processor seconds by test, of those that take one or more; what tests share is not among them."""
    rows = [line.split("\t") for line in MEASURED.read_text().splitlines()]
    return {name: float(seconds) for seconds, name in rows}


def pick_slow(seconds):
    """Tests to be marked slow.

    >>> sorted(pick_slow({"a[1]": 5.0, "a[2]": 6.0, "b": 16.0, "c": 3.0}))
    ['a[2]', 'b']
    """
    functions = defaultdict(list)
    for name, spent in seconds.items():
        functions[name.split("[")[0]].append((spent, name))
    slow = set()
    for cases in functions.values():
        cases.sort()
        first = 1 if cases[0][0] <= MOST else 0
        slow |= {name for spent, name in cases[first:] if spent >= SLOW}
    return slow


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Leave what collecting makes, which stays to the end, out of every later search for garbage."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    seconds = read_seconds()
    slow = pick_slow(seconds)
    of_file = defaultdict(float)
    for item in items:
        name = item.nodeid.removeprefix("tests/")
        if name in slow:
            item.add_marker("slow")
        else:
            of_file[item.path] += seconds.get(name, 0.0)
    # The last files are short, so that no worker waits long for another.
    items.sort(key=lambda item: -of_file[item.path])


def pytest_addoption(parser):
    parser.addoption("--processor-seconds", metavar="FILE", help="where each test's processor seconds go")
    parser.addoption("--write-said", action="store_true", help="write what pages and refusals say")


def spent():
    """Processor seconds of this process and of those that it waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Shared:
    """Processor seconds of fixtures that many tests share, which count for none of them.

    A plug-in of its own: for the fixtures of a session pytest asks none of the hooks of this file.
    """

    seconds, depth = 0.0, 0

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        if fixturedef.scope == "function" or self.depth:
            return (yield)
        before, self.depth = spent(), 1
        try:
            return (yield)
        finally:
            self.seconds, self.depth = self.seconds + spent() - before, 0


SHARED = Shared()


def pytest_configure(config):
    config.pluginmanager.register(SHARED)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item):
    before = spent() - SHARED.seconds
    result = yield
    if path := item.config.getoption("processor_seconds"):
        took = spent() - SHARED.seconds - before
        if took >= 1.0:
            with open(path, "a") as file:
                file.write(f"{took:.1f}\t{item.nodeid.removeprefix('tests/')}\n")
    return result


_PARTS = re.compile(r"^== (.*)\n((?:(?!== ).*\n)*)", re.MULTILINE)


def lines_of(html):
    """What a page or a part of one shows, a line a block, without scripts, styles and pictures."""
    html = re.sub(r"(?s)<(script|style|svg|head)\b.*?</\1>", "", str(html))
    html = re.sub(r'<div class="(alarm|card \w+)"[^>]*>', r"\n[\1] ", html)
    html = re.sub(
        r"</?(?:p|div|section|h\d|li|tr|table|summary|figcaption|nav|ul|ol|details)\b[^>]*>", "\n", html
    )
    plain = unescape(re.sub(r"<[^>]+>", " ", html)).replace("\N{NO-BREAK SPACE}", " ")
    return [" ".join(line.split()) for line in plain.split("\n") if line.strip()]


@pytest.fixture
def says(request):
    """Compare what texts and HTML show with a case of the module's ``.txt``; ``--write-said`` writes it.

    The first case stands there as a whole; of another, where that is shorter, the lines that the first has
    not, and how those begin that only the first has.
    """
    file = request.path.with_suffix(".txt")

    def check(case, *told):
        lines = [line for one in told for line in lines_of(one)]
        parts = dict(_PARTS.findall(file.read_text(encoding="utf-8"))) if file.exists() else {}
        if (first := next(iter(parts), case)) != case:
            rows = list(unified_diff(parts[first].splitlines(), lines, n=0, lineterm=""))[2:]
            rows = [row if row[0] == "+" else row[:24] for row in rows if row[0] != "@"]
            lines = min(rows, lines, key=lambda one: sum(map(len, one)))
        text = "".join(f"{line}\n" for line in lines)
        if request.config.getoption("--write-said"):
            parts[case] = text
            file.write_text("".join(f"== {name}\n{parts[name]}" for name in parts), encoding="utf-8")
        assert text == parts.get(case)

    return check


@pytest.fixture
def refuses(request, says, tmp_path):
    """Call what must be refused, and compare the sentence with the module's ``.txt``, as `says` does."""
    from wearscope.errors import InputError

    number = count(1)

    def check(call, *given, **options):
        with pytest.raises(InputError) as told:
            call(*given, **options)
        sentence = str(told.value).replace(str(tmp_path), "FOLDER").replace(str(ROOT), "ROOT")
        says(f"{request.node.name} {next(number)}", escape(sentence))

    return check
