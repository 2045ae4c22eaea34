"""Which tests are slow, by the processor seconds that each one took."""

import gc
import os
from collections import defaultdict
from pathlib import Path

import pytest

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
    parser.addoption("--write-said", action="store_true", help="write what pages say, for a reader to check")


def spent():
    """Processor seconds of this process and of those that it waited for."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Shared:
    """Processor seconds of fixtures that many tests share, which count for none of them."""

    seconds, depth = 0.0, 0


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef):
    if fixturedef.scope == "function" or Shared.depth:
        return (yield)
    before, Shared.depth = spent(), 1
    try:
        return (yield)
    finally:
        Shared.seconds, Shared.depth = Shared.seconds + spent() - before, 0


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item):
    before = spent() - Shared.seconds
    result = yield
    if path := item.config.getoption("processor_seconds"):
        took = spent() - Shared.seconds - before
        if took >= 1.0:
            with open(path, "a") as file:
                file.write(f"{took:.1f}\t{item.nodeid.removeprefix('tests/')}\n")
    return result
