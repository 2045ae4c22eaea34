"""A process of its own passes on what it does, and is ended where it does not go on."""

import os
import signal
import time

import pytest

from wearscope.errors import InputError
from wearscope.storage.files import DamagedFile
from wearscope.supervision import ProcessLost, call_supervised, run_supervised


def count():
    for number in range(5):
        yield number, os.getpid()


def test_items_come_in_order_from_another_process():
    items = list(run_supervised(count, 10.0))
    assert [number for number, _ in items] == list(range(5))
    assert {pid for _, pid in items} != {os.getpid()}


@pytest.mark.parametrize(
    "error", [InputError("one sentence."), DamagedFile("a/b", "a/b: is damaged."), ZeroDivisionError("no")]
)
def test_what_is_raised_is_raised_here(error):
    def work():
        yield 1
        raise error

    with pytest.raises(type(error), match=str(error)) as found:
        list(run_supervised(work, 10.0))
    assert vars(found.value).get("path") == vars(error).get("path")


def test_what_cannot_be_sent_is_raised_by_its_trace():
    class Own(Exception):
        pass

    def work():
        yield 1
        raise Own("mine")

    with pytest.raises(RuntimeError, match="Own: mine"):
        list(run_supervised(work, 10.0))


def test_limit_holds_for_each_item_not_for_all():
    def work():
        for number in range(6):
            time.sleep(0.15)
            yield number

    assert list(run_supervised(work, 0.5)) == list(range(6))

    def stuck():
        yield os.getpid()
        time.sleep(60)

    items = run_supervised(stuck, 0.5)
    pid = next(items)
    start = time.monotonic()
    with pytest.raises(ProcessLost, match=r"took longer than 0.5 s"):
        next(items)
    assert time.monotonic() - start < 5
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_work_goes_on_where_somebody_else_killed_it_once(tmp_path):
    done = []

    def work():
        for number in range(len(done), 4):
            if number == 2 and not (tmp_path / "killed").exists():
                (tmp_path / "killed").touch()
                os.kill(os.getpid(), signal.SIGKILL)
            yield number

    for number in run_supervised(work, 10.0):
        done.append(number)
    assert done == [0, 1, 2, 3]


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT", "SIGHUP"])
def test_a_process_that_is_killed_twice_is_told(name):
    number = signal.Signals[name]

    def end():
        if number != signal.SIGKILL:
            # Under nohup a process ignores SIGHUP from its start on.
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    with pytest.raises(InputError, match=rf"was killed twice \({name}\).*run the same command again"):
        call_supervised(end, 10.0, "adding")


def test_child_ends_when_nobody_waits_for_it():
    def endless():
        while True:
            yield os.getpid()
            time.sleep(0.01)

    items = run_supervised(endless, 5.0)
    pid = next(items)
    items.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_call_tells_what_took_too_long():
    assert call_supervised(lambda: 3, 10.0, "adding") == 3
    with pytest.raises(InputError, match=r"^adding took longer than 0.2 s; correct it, or raise time_limit"):
        call_supervised(lambda: time.sleep(60), 0.2, "adding")
    with pytest.raises(InputError, match=r"^adding ended its process \(exit code 4\)"):
        call_supervised(lambda: os._exit(4), 10.0, "adding")
