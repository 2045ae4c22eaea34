import pickle

import pytest

from wearscope.errors import LONGEST, InputError


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
