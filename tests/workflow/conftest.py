"""A clone to try studies in, and a study to spoil."""

from pathlib import Path

import pytest
import yaml
from clones import ROOT, TINY, copy_tree, run_well


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> Path:
    return copy_tree(tmp_path_factory.mktemp("bad-input"))


@pytest.fixture(scope="session")
def finished(tmp_path_factory) -> Path:
    """A copy in which the smallest study was run on one core; who changes it puts it back."""
    folder = copy_tree(tmp_path_factory.mktemp("one-core"))
    run_well(folder)
    return folder


@pytest.fixture
def bad() -> dict:
    config = yaml.safe_load((ROOT / TINY / "config.yaml").read_text())
    config["study"] = "bad"
    return config
