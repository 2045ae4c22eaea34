"""Whatever a URDF, YAML or setting holds: a sound result, or one sentence; test_hostile.py has the commands.

Fifty inputs a parser run with the rest of the tests, 2,000 with `make test-kills`.
"""

from pathlib import Path

import pytest
import yaml
from hypothesis import strategies as st
from mutations import changed_bytes, try_many

from wearscope.cli.workflow import read_setting
from wearscope.errors import InputError, explain_yaml
from wearscope.robots.urdf import normalise_urdf
from wearscope.storage.plain_yaml import load_plain_yaml

ROOT = Path(__file__).parents[2]
COUNTS = [50, pytest.param(2000, marks=pytest.mark.long)]


@pytest.mark.parametrize("count", COUNTS)
def test_any_urdf(count, tmp_path):
    text = (ROOT / "config" / "robots" / "medium" / "robot.urdf").read_bytes()
    path = tmp_path / "robot.urdf"
    numbers = st.sampled_from(["1e308", "-1e308", "1e-320", "nan", "inf", "0", "-1", "1e29", "", "x"])
    words = text.decode().split('"')

    @st.composite
    def changed_values(draw):
        parts = list(words)
        for _ in range(draw(st.integers(1, 3))):
            parts[2 * draw(st.integers(0, len(parts) // 2 - 1)) + 1] = draw(
                st.one_of(numbers, st.lists(numbers, min_size=3, max_size=3).map(" ".join))
            )
        return '"'.join(parts).encode()

    def attempt(content):
        path.write_bytes(content)
        for strict in (True, False):
            text = normalise_urdf(path, strict=strict)
            assert normalise_urdf(text) == text

    attempt(text)
    try_many(count, st.one_of(changed_values(), changed_bytes(text), st.binary(max_size=200)), attempt)


@pytest.mark.parametrize("count", COUNTS)
def test_any_yaml(count):
    """Anchors, aliases, merges, tags, depth and digits in any order."""
    part = st.sampled_from(
        ["a: ", "b: ", "&x ", "*x", "<<: ", "- ", "{", "}", "[", "]", ", ", "\n", "  ", "!!int ", "!!timestamp ",  # noqa: E501
         "!!python/name:os.system ", "!!bool ", "1", "0x" + "f" * 60, "1:2:3", ".inf", "'", '"', "? ", "|",
         "2024-13-45", "yes", "~", "\x00", "é", "#", "%YAML 9", "---", "..."],
    )  # fmt: skip
    text = st.lists(part, max_size=40).map("".join)

    def attempt(content):
        try:
            load_plain_yaml(content)
        except yaml.YAMLError as error:
            raise InputError(f"{explain_yaml(error)}.") from None

    try_many(count, text, attempt)


@pytest.mark.parametrize("count", COUNTS)
def test_any_setting(count):
    text = st.text(max_size=30)
    try_many(count, st.one_of(text, text.map("snr.runs=".__add__)), read_setting)
