"""The small robot of `arms.py` as a fixture."""

import pytest
from simulation import arms as small_arms


@pytest.fixture(scope="session")
def arms():
    """The module with the small robot and its motions."""
    return small_arms
