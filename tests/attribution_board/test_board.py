"""Baselines, and the board's runner with readers that know or do not know the truth."""

import json

import pandas as pd
import pytest

from wearscope.attribution_board.baselines import BASELINES, run_baselines
from wearscope.attribution_board.board import run_board
from wearscope.attribution_board.cases import EXTENTS, PLACES, Case, list_cases
from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.machines import MACHINES
from wearscope.attribution_board.outside import OUTSIDE
from wearscope.attribution_board.recipe import Planted, Recipe, RunPlan
from wearscope.attribution_board.score import score_case
from wearscope.errors import InputError

PLANS = (
    RunPlan("train", "fourier", 0, 24.0),
    RunPlan("train", "sweep", 1, 52.0),
    RunPlan("test", "points", 2, 40.0),
)
SHORT = Recipe(duration=7.0, plans=PLANS)


@pytest.fixture(scope="module")
def huge(tmp_path_factory):
    folder = tmp_path_factory.mktemp("huge") / "d1"
    truth = generate_dataset(folder, "stage", [Planted("viscous_asymmetry", "slide", 60.0)], 1, SHORT)
    return folder, truth


def test_baselines_find_a_huge_effect(huge):
    folder, truth = huge
    verdicts = run_baselines(folder / "dataset.yaml")
    assert tuple(verdicts) == BASELINES
    for method in ("largest_correlation", "stepwise_bic"):
        (row,) = score_case(truth, verdicts[method], method)
        assert row["outcome"] == "right"
        assert row["gap_closure"] > 0.9
    (entry,) = verdicts["largest_correlation"]["verdict"]
    low, high = entry["parameters"]["half_difference"]["ci95"]
    planted = truth["planted"][0]["parameters"]["half_difference"]["value"]
    assert low < entry["parameters"]["half_difference"]["value"] < high
    assert entry["parameters"]["half_difference"]["value"] == pytest.approx(planted, rel=0.03)


def test_baseline_verdicts_have_the_form_of_verdict_json(huge):
    for verdict in run_baselines(huge[0]).values():
        assert set(json.loads(json.dumps(verdict))) == {"dataset", "verdict", "joints"}
        assert set(verdict["joints"]["slide"]["test_runs"]) == {"runs/r3.parquet"}


def say_nothing(dataset, out_dir):
    (out_dir / "verdict.json").write_text(json.dumps({"dataset": "x", "verdict": [], "joints": {}}))


def fail(dataset, out_dir):
    raise ValueError("no idea")


CASES = [
    Case("stage", (Planted("stribeck", "slide", 8.0),), SHORT, 1),
    Case("stage", (), SHORT, 2),
]


def test_board_writes_its_tables_and_goes_on_where_it_was(tmp_path):
    lines = []
    summary = run_board("small", tmp_path, say_nothing, jobs=1, cases=CASES[:1], progress=lines.append)
    assert summary["tracer"]["cases"] == 1
    assert len(lines) == 1
    lines.clear()
    summary = run_board("small", tmp_path, fail, jobs=1, cases=CASES, progress=lines.append)
    assert "1 of 2 cases are already there" in lines[0]
    rows = pd.read_parquet(tmp_path / "board.parquet")
    own = rows[rows["method"] == "tracer"].set_index("kind")["outcome"]
    assert own["single"] == "none"
    assert own["null"] == "error"
    assert summary["tracer"]["errors"] == 1
    assert "no idea" in lines[-1]
    for name in ("confusion.parquet", "smallest_sizes.parquet", "summary.json", "board.md"):
        assert (tmp_path / name).stat().st_size > 0
    assert set(rows["method"]) == {"tracer", *BASELINES}


def test_a_reader_that_fails_on_a_null_counts_as_a_false_attribution(tmp_path):
    summary = run_board("small", tmp_path, fail, 1, cases=CASES[1:], baselines=False, progress=lambda _: None)
    assert summary["tracer"]["false_attribution"]["hits"] == 1


def test_the_tracer_gets_only_the_folder(tmp_path):
    seen = {}

    def look(dataset, out_dir):
        seen["files"] = sorted(str(p.relative_to(dataset.parent)) for p in dataset.parent.rglob("*.*"))
        seen["beside"] = sorted(p.name for p in dataset.parent.parent.iterdir())
        seen["name"] = dataset.parent.name
        say_nothing(dataset, out_dir)

    run_board("small", tmp_path, look, 1, cases=CASES[:1], baselines=False, progress=lambda _: None)
    runs = [f"runs/r{i}.parquet" for i in (1, 2, 3)]
    assert seen["files"] == ["dataset.yaml", "robot.urdf", *runs]
    assert seen["beside"] == [seen["name"], "out"]
    assert "stribeck" not in seen["name"]


@pytest.mark.parametrize("size", EXTENTS)
def test_cases_have_names_of_their_own_and_known_joints(size):
    cases = list_cases(size)
    assert len({case.name for case in cases}) == len(cases)
    for case in cases:
        assert all(plant.joint in MACHINES[case.robot].joints for plant in case.planted)
    assert [case.name for case in list_cases(size)] == [case.name for case in cases]
    assert {case.name for case in list_cases(size, seed=1)}.isdisjoint(case.name for case in cases)


def test_the_full_board_has_every_effect_and_300_nulls():
    cases = list_cases("full")
    planted = {plant.effect for case in cases for plant in case.planted}
    assert planted == set(PLACES) | set(OUTSIDE)
    assert sum(not case.planted for case in cases) >= 300
    assert {plant.size for case in cases for plant in case.planted} == {1.0, 2.0, 4.0, 8.0}
    assert sum(not case.planted for case in list_cases("full", nulls=31)) == pytest.approx(31, abs=2)


def test_an_unknown_size_is_refused():
    with pytest.raises(InputError, match="no size 'huge'; choose one of small, medium, full"):
        list_cases("huge")
