"""The check of words and sentences finds what it is for."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
import lint_words


def test_pages_keep_to_the_words():
    assert [line for page in lint_words.list_pages() for line in lint_words.check_page(page)] == []
    assert [line for file in lint_words.list_sources() for line in lint_words.check_words(file)] == []
    assert lint_words.check_sizes() == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("It is fitted beside the model.", "beside"),
        ("Measured on commit 5c69a3a of the code.", "5c69a3a"),
        ("So it was on seed 51 too.", "seed 51"),
        ("A spring stands for a balancer.", "stands for"),
        ("It says " + "one word after another and " * 10 + "then ends.", "a sentence of 54 words"),
        ("| a | " + "word " * 50 + "|", "a table's cell of 50 words"),
        ("This sentence " + "has a word more " * 6 + "than is good here.", "the mean sentence has"),
    ],
)
def test_what_is_not_used_is_found(tmp_path, monkeypatch, text, found):
    monkeypatch.setattr(lint_words, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n\n{text}\n")
    assert any(found in line for line in lint_words.check_page(page))


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("# Fitted beside it.", "beside"),
        ('\n"""A doc.\n\nIt stands for that."""', "stands for"),
        ('x = f"{1} was foretold"', "foretold"),
        ("def fit_beside(): ...", "beside"),
    ],
)
def test_words_of_code_are_checked_but_not_its_syntax(tmp_path, monkeypatch, code, found):
    monkeypatch.setattr(lint_words, "ROOT", tmp_path)
    file = tmp_path / "module.py"
    file.write_text(f"{code}\ny = [k for k in range(3)]\n")
    (wrong,) = lint_words.check_words(file)
    assert found in wrong and wrong.startswith(f"module.py:{1 + code[: code.index(found)].count(chr(10))}:")


def test_code_tables_and_headings_are_no_sentences():
    text = "# A heading of a page\n\n| a | table of words |\n\n```sh\nrun it now please\n```\n"
    assert lint_words.find_sentences(f"{text}\nOne is left here.\n") == ["One is left here."]
    assert lint_words.find_sentences(text) == []
