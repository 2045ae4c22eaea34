"""Inputs changed at random, for tests that ask: a result, or one sentence."""

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wearscope.errors import InputError


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
