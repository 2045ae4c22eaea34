"""PyBullet, imported without the line about its build time that its C code prints in every process."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

BANNER = b"pybullet build time:"


@contextmanager
def drop_banner() -> Iterator[None]:
    """Hold back what is written to standard error, also by C code, and pass on all but PyBullet's banner.

    What was held back is passed on too where the body raises. Without a standard error, or room for a
    temporary file, nothing is held back.
    """
    try:
        held = tempfile.TemporaryFile()
        kept = os.dup(2)
    except OSError:
        yield
        return
    _flush()
    with held:
        os.dup2(held.fileno(), 2)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, 2)
            os.close(kept)
            held.seek(0)
            for line in held:
                if not line.startswith(BANNER):
                    os.write(2, line)


def _flush() -> None:
    if sys.stderr is not None:
        sys.stderr.flush()


with drop_banner():
    import pybullet

__all__ = ["drop_banner", "pybullet"]
