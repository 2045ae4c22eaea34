import pickle

import pytest
import yaml

from wearscope.errors import LONGEST, InputError, explain_yaml
from wearscope.storage.plain_yaml import load_plain_yaml


@pytest.mark.parametrize("odd", ["a\nb", "\x1b[2J", "\r", "\u2028", "\ud800", "\x00"])
def test_what_is_quoted_neither_breaks_the_line_nor_steers_a_terminal(odd):
    text = str(InputError(f"name {odd!s}: correct it."))
    assert text.isprintable() and text.startswith("name ") and text.endswith(": correct it.")


def test_long_quotes_are_cut_and_the_remedy_stays():
    text = str(InputError(f"config: {'x' * 5000} is wrong; correct it."))
    assert len(text) < LONGEST + 10 and text.endswith("x is wrong; correct it.")


def test_sentence_survives_the_way_between_processes():
    error = InputError("Größe: 3 °C is too low; raise it.")
    assert str(pickle.loads(pickle.dumps(error))) == str(error) == "Größe: 3 °C is too low; raise it."


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", "line 3, column 2: expected ',' or ']', but got ':', "
         "while parsing a flow sequence that begins in line 2"),
        ("a: 1\n\tb: 2\n", "line 2, column 1: found character '\\t' that cannot start any token"),
    ],
)  # fmt: skip
def test_a_line_of_yaml_is_named(text, told):
    with pytest.raises(yaml.YAMLError) as caught:
        yaml.safe_load(text)
    assert explain_yaml(caught.value).startswith(told)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: 2\na: 3\n", "line 3, column 1: 'a' stands twice"),
        ("a: 1\n'a': 1\n", "line 2, column 1: 'a' stands twice"),
        ("x:\n- {b: 1, c: 2, b: 3}\n", "line 2, column 16: 'b' stands twice"),
    ],
)
def test_a_key_that_stands_twice_is_refused(text, told):
    with pytest.raises(yaml.YAMLError) as caught:
        load_plain_yaml(text)
    assert explain_yaml(caught.value).startswith(told)


@pytest.mark.parametrize(
    "text",
    [
        "a: {x: 1}\nb: {x: 1}\n",  # in two mappings
        "a: &a {x: 1, y: 2}\nb:\n  <<: *a\n  x: 3\nc:\n  <<: *a\n  x: 4\nd: *a\n",  # overruled on purpose
        "1: a\n'1': b\n",  # a number and a text
        "[a, a]",
    ],
)
def test_other_yaml_is_read_as_ever(text):
    assert load_plain_yaml(text) == yaml.safe_load(text)
