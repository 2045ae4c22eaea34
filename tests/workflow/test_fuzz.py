"""Whatever a file from someone else holds: a result, or one sentence.

Fifty inputs a parser run with the rest of the tests, 2,000 with `make test-kills`.
"""

import io
import json
import shutil
import tarfile
from pathlib import Path

import pandas as pd
import pytest
import yaml
from click.testing import CliRunner
from hypothesis import strategies as st
from mutations import changed_bytes, changed_trees, try_many

from wearscope.archive.packing import walk_archive
from wearscope.cli.main import wearscope
from wearscope.cli.workflow import read_setting
from wearscope.config import load_config
from wearscope.errors import InputError, explain_yaml
from wearscope.export.run import list_parameters
from wearscope.robots.model import check_effects, load_model
from wearscope.robots.model_file import list_effects, read_model_file
from wearscope.robots.urdf import normalise_urdf
from wearscope.simulation.feasibility import check_robot
from wearscope.storage.plain_yaml import load_plain_yaml
from wearscope.storage.verdicts import read_verdict

ROOT = Path(__file__).parents[2]
RELEASE = Path(__file__).parent / "archives" / "release-0.1.0.tar"
RANGES = {
    "f": ("wear", 0.0, 50.0),
    "w3": ("temperature", 30.0, 70.0),
    "w5": ("payload_mass_error", -10.0, 10.0),
}
COUNTS = [50, pytest.param(2000, marks=pytest.mark.long)]


@pytest.mark.parametrize("count", COUNTS)
def test_any_configuration(count):
    good = yaml.safe_load((ROOT / "config" / "config.yaml").read_text())
    load_config(good)
    try_many(count, changed_trees(good), load_config)


@pytest.mark.parametrize("count", COUNTS)
def test_any_model_file(count, tmp_path):
    shutil.copytree(ROOT / "config" / "robots" / "medium", tmp_path / "arm")
    path = tmp_path / "arm" / "model.yaml"
    text = path.read_bytes()
    good = yaml.safe_load(text)

    def attempt(content):
        path.write_bytes(content if isinstance(content, bytes) else yaml.safe_dump(content).encode())
        list_effects(read_model_file(path), str(path))
        model = load_model(path)
        check_effects(model)
        check_robot(model, RANGES, 0.001)

    attempt(text)
    plain = st.one_of(
        st.binary(max_size=200), st.text(max_size=200).map(lambda one: one.encode("utf-8", "replace"))
    )
    try_many(count, st.one_of(changed_trees(good).filter(is_dumped), changed_bytes(text), plain), attempt)


def is_dumped(tree):
    try:
        yaml.safe_dump(tree)
        return True
    except (yaml.YAMLError, ValueError, TypeError):
        return False


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
def test_any_archive(count, tmp_path):
    path = tmp_path / "a.tar"
    with tarfile.open(RELEASE) as tar:
        members = [(one.name, tar.extractfile(one).read()) for one in tar]
    manifest = json.loads(members[0][1])
    small = RELEASE.read_bytes()[: 60 * 1024]

    def attempt(content):
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            text = json.dumps(content).encode()
            with tarfile.open(path, "w") as tar:
                for name, one in [("MANIFEST.json", text), *members[1:]]:
                    header = tarfile.TarInfo(name)
                    header.size = len(one)
                    tar.addfile(header, io.BytesIO(one))
        walk_archive(path)

    attempt(manifest)
    trees = changed_trees(manifest).filter(is_json)
    try_many(count, st.one_of(trees, changed_bytes(small), st.binary(max_size=2000)), attempt)


@pytest.mark.parametrize("count", COUNTS)
def test_any_verdict(count, tmp_path):
    path, other = tmp_path / "a" / "verdict.json", tmp_path / "b" / "verdict.json"
    good = {"joints": {"j1": {"rms_before": 2.0, "rms_after": 1.0, "unit": "N m"}}, "verdict": [
        {"joint": "j1", "effect": "stribeck", "parameters": {"level": {"value": 1.0, "ci95": [0.5, 1.5]}}},
    ]}  # fmt: skip
    for one in (path, other):
        one.parent.mkdir()
        one.write_text(json.dumps(good))

    def attempt(content):
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        list_parameters(load_model("medium"), read_verdict(path))
        done = CliRunner().invoke(wearscope, ["compare", str(path.parent), str(other.parent)])
        if done.exception is not None:
            raise done.exception
        assert done.output.replace("\n", "").isprintable()

    attempt(good)
    changed = changed_bytes(json.dumps(good).encode())
    try_many(count, st.one_of(changed_trees(good).filter(is_json), changed), attempt, least=4)


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
@pytest.mark.parametrize("kind", ["csv", "json", "parquet"])
def test_any_file_that_is_shown(count, kind, tmp_path):
    path = tmp_path / f"a.{kind}"
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": ["x", "\x1b[2J"]})
    good = {
        "csv": frame.to_csv().encode(), "json": frame.to_json().encode(), "parquet": frame.to_parquet(),
    }[kind]  # fmt: skip

    def attempt(content):
        path.write_bytes(content)
        done = CliRunner().invoke(wearscope, ["show", str(path)])
        if done.exception is not None:
            raise done.exception
        assert done.output.replace("\n", "").isprintable()

    text = st.text(max_size=60).map(lambda one: one.encode("utf-8", "replace"))
    try_many(count, st.one_of(changed_bytes(good), st.binary(max_size=99), text), attempt, least=0)


@pytest.mark.parametrize("count", COUNTS)
def test_any_setting(count):
    text = st.text(max_size=30)
    try_many(count, st.one_of(text, text.map("snr.runs=".__add__)), read_setting)


def is_json(tree):
    try:
        json.dumps(tree)
        return True
    except (ValueError, TypeError):
        return False
