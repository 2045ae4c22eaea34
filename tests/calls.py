"""Commands as processes of their own."""

import subprocess
import sys
import time


def call(*words, folder=None, **options):
    """How a command ended, and what it said, as text."""
    words = [str(word) for word in words]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, **options)


def call_python(*words, **options):
    return call(sys.executable, *words, **options)


def start(*words, folder, **options):
    """A command that runs on, in a session of its own; what it says goes where `options` say, or nowhere."""
    words, silent = [str(word) for word in words], subprocess.DEVNULL
    streams = {"stdout": silent, "stderr": silent} | options
    return subprocess.Popen(words, cwd=folder, start_new_session=True, **streams)


def wait_until(holds, seconds=10.0, step=0.05):
    """Whether something comes to hold within some seconds."""
    end = time.monotonic() + seconds
    while not (held := holds()) and time.monotonic() < end:
        time.sleep(step)
    return held
