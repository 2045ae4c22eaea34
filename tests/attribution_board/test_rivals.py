"""The rivals recover what is planted in a table, and say nothing of noise; the bound is a bound."""

import numpy as np
import pytest

from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.recipe import Planted, Recipe, RunPlan
from wearscope.attribution_board.rival_table import RivalTable, make_tables
from wearscope.attribution_board.rivals import RIVALS, bound_gain, find_inclusion, run_rivals

NAMES = ("a", "b", "c", "d", "e", "f")


def make_table(weights, noise, seed=0, rows=1500):
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(rows, len(NAMES)))
    columns[:, 1] = 0.6 * columns[:, 0] + 0.8 * columns[:, 1]
    columns /= np.sqrt(np.mean(columns**2, axis=0))
    target = columns @ np.asarray(weights) + noise * rng.normal(size=rows)
    return RivalTable("j1", columns, target, np.arange(rows) // 15, NAMES, columns)


@pytest.mark.parametrize("rival", RIVALS)
def test_two_planted_columns_are_named_and_no_other(rival):
    table = make_table((1.0, 0.0, 0.0, -0.8, 0.0, 0.0), 0.4)
    assert sorted(RIVALS[rival](table, np.random.default_rng(0))) == ["a", "d"]


def test_a_column_that_is_there_twice_is_no_error():
    table = make_table((1.0, 0.0, 0.0, -0.8, 0.0, 0.0), 0.4)
    columns = np.column_stack([table.columns, table.columns[:, 0], table.columns[:, 3]])
    twice = RivalTable("j1", columns, table.target, table.blocks, (*NAMES, "a2", "d2"), columns)
    said = RIVALS["stability_selection"](twice, np.random.default_rng(0))
    assert {name[0] for name in said} == {"a", "d"}


@pytest.mark.parametrize("rival", [name for name in RIVALS if name not in ("ensemble_sindy", "ard")])
def test_noise_alone_is_named_seldom(rival):
    said = [
        RIVALS[rival](make_table(np.zeros(6), 1.0, seed), np.random.default_rng(seed)) for seed in range(20)
    ]
    assert sum(map(len, said)) <= 6


def test_inclusion_agrees_with_the_sum_over_all_models():
    table = make_table((0.12, 0.0, 0.1, 0.0, 0.0, 0.0), 1.0, 4)
    blocks, power = 100, float(np.sum(table.target**2))
    weights = {}
    for code in range(2**6):
        inside = [i for i in range(6) if code >> i & 1]
        left = 1.0
        if inside:
            x = table.columns[:, inside]
            left -= float(table.target @ x @ np.linalg.solve(x.T @ x, x.T @ table.target)) / power
        evidence = 0.5 * (blocks - 1 - len(inside)) * np.log1p(blocks)
        evidence -= 0.5 * (blocks - 1) * np.log1p(blocks * left)
        weights[code] = evidence + len(inside) * np.log(1 / 5)
    top = max(weights.values())
    share = {code: np.exp(w - top) for code, w in weights.items()}
    whole = sum(share.values())
    found = find_inclusion(table, np.random.default_rng(1), sweeps=3000, burn=100)
    for i, name in enumerate(NAMES):
        exact = sum(s for code, s in share.items() if code >> i & 1) / whole
        assert found[name] == pytest.approx(exact, abs=0.05)


def test_boosting_bounds_what_a_name_can_explain():
    share = bound_gain(make_table((1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.5, rows=4000))
    assert 0.6 < share < 0.81
    assert bound_gain(make_table(np.zeros(6), 1.0)) < 0.05


def test_a_folder_gives_tables_in_which_the_plant_stands_out(tmp_path):
    plans = (RunPlan("train", "fourier", 0, 30.0), RunPlan("train", "sweep", 1, 30.0))
    recipe = Recipe(duration=8.0, plans=(*plans, RunPlan("test", "points", 2, 30.0)))
    generate_dataset(tmp_path / "d1", "stage", [Planted("viscous_asymmetry", "slide", 10.0)], 3, recipe)
    (table,) = make_tables(tmp_path / "d1")
    assert np.allclose(np.mean(table.columns**2, axis=0), 1.0)
    column = table.columns[:, table.find_columns("viscous_asymmetry")[0]]
    assert abs(np.corrcoef(column, table.target)[0, 1]) > 0.9
    said = run_rivals(tmp_path / "d1", 0)
    assert "viscous_asymmetry" in [e["effect"] for e in said["stepwise_bic"]["verdict"]]
    assert said["boosting"]["bound"]["slide"] > 0.3
    assert run_rivals(tmp_path / "d1", 0) == said
