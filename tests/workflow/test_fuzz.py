"""Whatever a file from someone else holds: a result, or one sentence.

A hundred inputs a parser run with the rest of the tests, a thousand with `make test-kills`.
"""

import copy
import io
import json
import shutil
import tarfile
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wearscope.archive import verify_archive
from wearscope.config import load_config
from wearscope.errors import InputError
from wearscope.robots.model import check_effects, load_model
from wearscope.robots.model_file import list_effects, read_model_file
from wearscope.robots.urdf import normalise_urdf
from wearscope.simulation.feasibility import check_robot

ROOT = Path(__file__).parents[2]
RELEASE = Path(__file__).parent / "archives" / "release-0.1.0.tar"
RANGES = {
    "f": ("wear", 0.0, 50.0),
    "w3": ("temperature", 30.0, 70.0),
    "w5": ("payload_mass_error", -10.0, 10.0),
}
COUNTS = [100, pytest.param(1000, marks=pytest.mark.long)]

ODD = st.sampled_from(
    [
        None, True, "", "..", "../x", "/etc/passwd", "a\x00b", "{x}", "$(x)", "é" * 300, "x" * 5000,
        -1, 0, 1e308, 1e-308, float("nan"), float("inf"), 10**400, [], {}, [[[]]], {"": {}},
        {"effect": "x.py"}, "1e400", "nan",
    ]
)  # fmt: skip
VALUES = st.one_of(
    ODD,
    st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20)),
        lambda inner: st.one_of(
            st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)
        ),
        max_leaves=8,
    ),
)


def list_places(node, place=()):
    """Paths of all nodes below a root."""
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in children:
        yield (*place, key)
        yield from list_places(child, (*place, key))


@st.composite
def changed_trees(draw, tree):
    """A mapping of which some nodes were replaced, removed, doubled or renamed."""
    tree = copy.deepcopy(tree)
    for _ in range(draw(st.integers(1, 3))):
        *way, last = draw(st.sampled_from(list(list_places(tree)) or [("x",)]))
        node = tree
        for key in way:
            node = node[key]
        what = draw(st.sampled_from(["replace", "remove", "add"]))
        if what == "replace" or last not in (node if isinstance(node, dict) else range(len(node))):
            node[last] = draw(VALUES)
        elif what == "remove":
            del node[last]
        elif isinstance(node, dict):
            node[draw(st.one_of(st.text(max_size=8), st.integers()))] = draw(VALUES)
        else:
            node.append(draw(VALUES))
    return tree


@st.composite
def changed_bytes(draw, content):
    """Bytes of which some were flipped, cut out, doubled, or replaced."""
    content = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(content) - 1, 0)))
        end = min(start + draw(st.integers(1, 40)), len(content))
        what = draw(st.sampled_from(["flip", "cut", "double", "put"]))
        if what == "flip" and content:
            content[start] ^= 1 << draw(st.integers(0, 7))
        elif what == "cut":
            del content[start:end]
        elif what == "double":
            content[start:start] = content[start:end]
        else:
            content[start:end] = draw(st.binary(max_size=40))
    return bytes(content)


def try_many(count, inputs, attempt):
    """Attempt each input; return how many were accepted and refused."""
    outcomes = {"accepted": 0, "refused": 0}

    @settings(
        max_examples=count,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(inputs)
    def run(content):
        try:
            attempt(content)
            outcomes["accepted"] += 1
        except InputError as error:
            outcomes["refused"] += 1
            text = str(error)
            assert len(text.splitlines()) == 1 and text.endswith("."), text

    run()
    assert outcomes["refused"] > count // 10, "the inputs do not reach what is checked"
    return outcomes


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
        verify_archive(path)

    attempt(manifest)
    trees = changed_trees(manifest).filter(is_json)
    try_many(count, st.one_of(trees, changed_bytes(small), st.binary(max_size=2000)), attempt)


def is_json(tree):
    try:
        json.dumps(tree)
        return True
    except (ValueError, TypeError):
        return False
