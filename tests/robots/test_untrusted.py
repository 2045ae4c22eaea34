"""Model files and URDFs that may come from someone else: a result or one sentence, and no code runs."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

from wearscope.errors import InputError
from wearscope.limits import TEXT_BYTES
from wearscope.robots.model import load_model
from wearscope.robots.model_file import list_effects, read_model_file, read_text
from wearscope.robots.urdf import parse_urdf

ROOT = Path(__file__).parents[2]
MEDIUM = ROOT / "config" / "robots" / "medium"


@pytest.fixture
def robot(tmp_path):
    shutil.copytree(MEDIUM, tmp_path / "mine")
    return tmp_path / "mine" / "model.yaml"


def change(robot, **fields):
    content = yaml.safe_load(robot.read_text()) | fields
    robot.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"a: [", "is not readable YAML"),
        (b"a: *b", "is not readable YAML"),
        (b"\x00", "is not readable YAML"),
        (b"\xff\xfe", "is not a text file"),
        (b"urdf: " + b"9" * 6000, "is not readable YAML"),
        (b"a: " + b"[" * 3000, "is not readable YAML"),
        (b"!!python/object/apply:os.system ['touch /tmp/evil']", "is not readable YAML"),
        (b"- 1", "holds no mapping"),
        (b"", "holds no mapping"),
        (b"1: 2", "a key is no text"),
        (b"name: a", "urdf: is missing"),
        (b"urdf: [1]", "urdf: is missing or no text"),
        (b"urdf: a\neffects: 3", "effects: is no list"),
        (b"urdf: a\neffects: {a: b}", "effects: is no list"),
        (b"urdf: a\neffects: [3]", r"effects\[0\].joint: is missing"),
        (b"urdf: a\neffects: [{joint: j}]", r"effects\[0\].effect: is missing"),
        (b"urdf: a\neffects: [{joint: j, effect: [x]}]", r"effects\[0\].effect: is missing or no text"),
    ],
)
def test_malformed_model_file_gets_one_sentence(robot, text, words):
    robot.write_bytes(text)
    for read in (read_model_file, load_model):
        with pytest.raises(InputError, match=words) as found:
            read(robot)
        assert "\n" not in str(found.value) and str(found.value).startswith(str(robot))


def test_missing_file_is_told_once(tmp_path):
    path = tmp_path / "not.urdf"
    with pytest.raises(InputError) as caught:
        read_text(path, "the robot's URDF")
    told = f"{path}: no such file; name the robot's URDF."
    assert str(caught.value) == told


def test_effects_are_listed_once_and_sorted():
    fields = {"effects": [{"joint": "a", "effect": name} for name in ("viscous", "coulomb", "viscous")]}
    assert list_effects(fields, "model") == ["coulomb", "viscous"]
    assert list_effects({}, "model") == []


def test_pipe_and_giant_are_not_read(robot, tmp_path, refuses):
    urdf = robot.with_name("robot.urdf")
    urdf.unlink()
    os.mkfifo(urdf)
    refuses(load_model, robot)
    urdf.unlink()
    with open(urdf, "wb") as file:
        file.truncate(TEXT_BYTES + 1)
    refuses(load_model, robot)
    change(robot, urdf="a\x00b")
    refuses(load_model, robot)


def test_code_of_a_robot_runs_only_when_it_is_allowed(robot, tmp_path, refuses):
    bait = tmp_path / "mine" / "payload.py"
    bait.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\nEFFECT = None\n")
    change(robot, effects=[{"joint": "axis_1", "effect": str(bait)}])
    for allowed in (False, [], [str(tmp_path / "other.py")]):
        refuses(load_model, robot, allow_code=allowed)
    assert not (tmp_path / "ran").exists()
    for allowed in (True, [str(bait)]):
        assert load_model(robot, allow_code=allowed).effects[0].effect == str(bait)


def entities(text):
    return f'<?xml version="1.0"?><!DOCTYPE robot [{text}]><robot name="&a;"/>'


@pytest.mark.parametrize(
    "declared",
    [
        '<!ENTITY a "b">',
        '<!ENTITY a SYSTEM "file:///etc/hostname">',
        '<!ENTITY % p SYSTEM "http://localhost/evil.dtd"> %p;',
        '<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;&x;"><!ENTITY a "&y;&y;&y;&y;">',
    ],
)
def test_entities_are_refused(declared, refuses):
    refuses(parse_urdf, entities(declared))


def test_number_beyond_computing_is_told(robot, refuses):
    urdf = robot.with_name("robot.urdf")
    text = urdf.read_text()
    for old, new in (('ixz="', 'ixz="1e308" was="'), ('<mass value="', '<mass value="1e200" was="')):
        assert old in text
        urdf.write_text(text.replace(old, new))
        refuses(load_model, robot)


def test_deep_and_wide_files_are_refused_soon(refuses):
    with pytest.raises(InputError):
        parse_urdf("<robot>" + "<a>" * 200_000)
    links = "".join(f'<link name="l{k}"/>' for k in range(5001))
    refuses(parse_urdf, f"<robot>{links}</robot>")
