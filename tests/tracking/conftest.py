"""A small arm over its sessions, identified once."""

from collections.abc import Callable
from pathlib import Path

import pytest
from session_machine import HEALTHY, LATER, write_machine

from wearscope.tracking.reference import Reference, identify_reference
from wearscope.tracking.session import Assessment, assess_session
from wearscope.tracking.session_names import Sessions, read_sessions


@pytest.fixture(scope="session")
def machine(tmp_path_factory) -> Path:
    """The arm over `HEALTHY` and `LATER`."""
    return write_machine(tmp_path_factory.mktemp("sessions") / "duo", HEALTHY + LATER, len(HEALTHY))


@pytest.fixture(scope="session")
def sessions(machine) -> Sessions:
    return read_sessions(machine)


@pytest.fixture(scope="session")
def reference(sessions) -> Reference:
    """The healthy arm."""
    return identify_reference(sessions)[0]


@pytest.fixture(scope="session")
def assessments(sessions, reference) -> dict[str, Assessment]:
    """All later sessions compared with the healthy arm."""
    return {session: assess_session(sessions, session, reference) for session in sessions.later}


@pytest.fixture
def write(tmp_path) -> Callable[..., Path]:
    """`write_machine` into the test's own folder."""
    return lambda *args, **kwargs: write_machine(tmp_path / "duo", *args, **kwargs)
