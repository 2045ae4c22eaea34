"""Two runs of the same cases against each other: what was won and lost, and its probability by chance."""

import pandas as pd
import pytest
from scipy.stats import binomtest

from benchmarks.paired import compare, main
from wearscope.storage.tables import write_table


def make_cases(exact, **columns):
    count = len(exact)
    table = {
        "dataset": [f"d{k}" for k in range(count)], "told": [f"case {k}" for k in range(count)],
        "exact": exact, "extra": [0] * count, "missed": [0] * count, "false_unexplained": [0] * count,
        "worse": [False] * count, "error": [""] * count, "seconds": [2.0] * count,
        "worst_ratio": [0.5] * count,
    }  # fmt: skip
    return pd.DataFrame(table | columns)


def test_wins_and_losses_are_paired_by_case():
    before, after = make_cases([True] * 4 + [False] * 8), make_cases([False] + [True] * 11)
    row = compare(before.sample(frac=1.0, random_state=1), after).set_index("score").loc["exact"]
    assert (row["before"], row["after"], row["lost"]) == (4, 11, "d0")
    assert set(row["won"].split()) == {f"d{k}" for k in range(4, 12)}
    assert row["p"] == pytest.approx(binomtest(1, 9).pvalue)


def test_what_was_not_judged_is_not_compared():
    before = make_cases([True] * 3, extra=[None, 0, 0], false_unexplained=[None, 2, 0])
    rows = compare(before, make_cases([True] * 3, extra=[1, 1, 0])).set_index("score")
    assert rows.loc["no extra name", ["cases", "lost"]].tolist() == [2, "d1"]
    assert rows.loc["no joint falsely unexplained", ["cases", "won"]].tolist() == [2, "d1"]
    assert rows.loc["exact", "p"] == 1.0


def write(folder, cases, covered):
    write_table(folder / "cases.parquet", cases)
    write_table(folder / "entries.parquet", pd.DataFrame({"dataset": ["d0", "d1"], "covered": covered}))
    return str(folder)


def test_the_command_lists_cases_and_refuses_strangers(tmp_path, capsys):
    one = write(tmp_path / "one", make_cases([True, False]), [1.0, 0.0])
    two = write(tmp_path / "two", make_cases([True, True], seconds=[1.0, 1.0]), [1.0, None])
    other = make_cases([True]).assign(dataset="e0")
    assert main([one, two]) == 0
    text = capsys.readouterr().out
    assert (
        "won, exact: case 1" in text and "1 of 2 before, 1 of 1 after" in text and "4 before, 2 after" in text
    )
    assert main([one, write(tmp_path / "other", other, [1.0, 1.0])]) == 2
    assert "have no case in common" in capsys.readouterr().err
