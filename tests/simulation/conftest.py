"""The robots of `arms.py` as fixtures: tests are collected by path, so its module is loaded by path too."""

import importlib.util
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location("simulation_arms", Path(__file__).with_name("arms.py"))
_ARMS = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_ARMS)


@pytest.fixture(scope="session")
def arms():
    """The module with the small robot and its motions."""
    return _ARMS
