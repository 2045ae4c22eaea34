"""Inputs changed at random, for tests that ask: a result, or one sentence."""

import copy

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wearscope.errors import InputError

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
            node[last] = copy.deepcopy(draw(VALUES))
        elif what == "remove":
            del node[last]
        elif isinstance(node, dict):
            node[draw(st.one_of(st.text(max_size=8), st.integers()))] = copy.deepcopy(draw(VALUES))
        else:
            node.append(copy.deepcopy(draw(VALUES)))
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


def try_many(count, inputs, attempt, least=10):
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
            assert len(text.splitlines()) == 1 and text.endswith((".", "?")), text

    run()
    assert not least or outcomes["refused"] > count // least, "the inputs do not reach what is checked"
    return outcomes
