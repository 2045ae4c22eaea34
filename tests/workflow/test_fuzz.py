"""Whatever a URDF, YAML or setting holds: a sound result, or one sentence; test_hostile.py has the commands.

Fifty inputs a parser run with the rest of the tests, 2,000 with `make test-kills`.
"""

from pathlib import Path

import pytest
import yaml
from hostile.files import spoil_urdf
from hostile.trees import spoil_bytes, spoil_often, spoil_yaml

from wearscope.cli.workflow import read_setting
from wearscope.errors import InputError, explain_yaml
from wearscope.robots.urdf import normalise_urdf
from wearscope.storage.plain_yaml import load_plain_yaml

ROOT = Path(__file__).parents[2]


def read_urdf(content, path):
    path.write_bytes(content)
    for strict in (True, False):
        text = normalise_urdf(path, strict=strict)
        assert normalise_urdf(text) == text


def read_yaml(content, _):
    try:
        load_plain_yaml(content.decode("latin-1"))
    except yaml.YAMLError as error:
        raise InputError(f"{explain_yaml(error)}.") from None


def read_words(content, _):
    read_setting(content.decode("latin-1"))


CASES = {
    "urdf": (ROOT / "config" / "robots" / "medium" / "robot.urdf", read_urdf, (spoil_urdf, spoil_bytes)),
    "yaml": (ROOT / "config" / "quick.yaml", read_yaml, (spoil_yaml, spoil_bytes)),
    "setting": (b"snr.runs=[1, {a: 2}]", read_words, (spoil_bytes,)),
}


@pytest.mark.parametrize("count", [50, pytest.param(2000, marks=pytest.mark.long)])
@pytest.mark.parametrize("kind", CASES)
def test_any_input_is_read_or_refused_in_one_sentence(kind, count, tmp_path):
    sound, read, ways = CASES[kind]
    sound = sound if isinstance(sound, bytes) else sound.read_bytes()
    read(sound, tmp_path / "sound")
    refused = 0
    for content in (one for spoil in ways for one in spoil_often(spoil, sound, count // len(ways))):
        try:
            read(content, tmp_path / "spoilt")
        except InputError as error:
            refused += 1
            text = str(error)
            assert len(text.splitlines()) == 1 and text.endswith((".", "?")), text
    assert refused > count // 10, "the inputs do not reach what is checked"
