"""Boards of several seeds as one: hits and cases add up, and no case counts twice."""

import json

import pytest

from benchmarks.board.regimes import list_cases
from benchmarks.pool import main
from benchmarks.runner import failed_result


def make_board(folder, seed):
    """Two planted cases of a seed, the first of them exact, and a null that is silent."""
    cases = list_cases("development", 12, seed)
    planted = [case for case in cases if case.planted and not case.axes["plants"] == "outside"][:2]
    silent = next(case for case in cases if not case.planted)
    (folder / "cases").mkdir(parents=True)
    for case in [*planted, silent]:
        result = failed_result(case, None, "", 1.0)
        result["case"] |= {
            "null": not case.planted,
            "outcome": "exact",
            "exact": case in planted[:1],
            "outside_answered": None,
        }
        result["case"] |= {"false_in_null": None if case.planted else False, "worse": False}
        result["case"] |= {"extra": 0, "unknowns": 0, "named": 0, "required": len(case.planted)}
        (folder / "cases" / f"{case.name}.json").write_text(json.dumps(result))
    return folder


def test_cases_of_two_seeds_add_up(tmp_path, capsys):
    boards = [make_board(tmp_path / f"seed{seed}", seed) for seed in (1, 2)]
    assert main([*map(str, boards), "--out", str(tmp_path / "both")]) == 0
    summary = json.loads((tmp_path / "both" / "summary.json").read_text())
    assert summary["cases"] == 6
    exact = summary["total"]["exact"]
    assert (exact["hits"], exact["cases"]) == (2, 4)
    assert (summary["total"]["false_in_null"]["hits"], summary["total"]["false_in_null"]["cases"]) == (0, 2)
    assert "50.0 % (2/4" in capsys.readouterr().out


def test_a_case_is_not_counted_twice(tmp_path, capsys):
    board = str(make_board(tmp_path / "board", 1))
    assert main([board, board, "--out", str(tmp_path / "both")]) == 2
    assert "pool each board once" in capsys.readouterr().err and not (tmp_path / "both").exists()


@pytest.mark.parametrize("text", ["{", "[]", '{"case": {}}'])
def test_what_is_no_result_is_named(tmp_path, capsys, text):
    (tmp_path / "cases").mkdir()
    (tmp_path / "cases" / "0001-d.json").write_text(text)
    assert main([str(tmp_path), "--out", str(tmp_path / "both")]) == 2
    assert "0001-d.json: not the result of a case" in capsys.readouterr().err


def test_a_folder_without_cases_is_named(tmp_path, capsys):
    assert main([str(tmp_path), "--out", str(tmp_path / "both")]) == 2
    assert "name the --out of a board" in capsys.readouterr().err
