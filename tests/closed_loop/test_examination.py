"""Isolability, dependence, black box and forward simulation against known structures."""

import json

import numpy as np
import pandas as pd
import pytest

from wearscope.closed_loop.diagnostics import forward
from wearscope.closed_loop.diagnostics.black_box import fit_black_box, judge_black_box
from wearscope.closed_loop.diagnostics.dependence import diagnose_residuals, find_dependence
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.prediction import Predicted, predict_runs
from wearscope.closed_loop.run import close_loop
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.significance import make_flips
from wearscope.simulation.errors import SimulationError


@pytest.fixture
def fit_declared(pose):
    """Prepared data of a folder, its layout, and the declared model fitted to it."""

    def fit(folder):
        problem = pose(folder)
        layout = problem.layout
        model = fit_declared_model(problem.prepared, problem.declared_terms, problem.inertial, layout.blocks)
        return problem.prepared, layout, model

    return fit


@pytest.fixture
def dependence_of(fit_declared):
    """The same with the table of dependence."""

    def find(folder):
        prepared, layout, model = fit_declared(folder)
        flips = make_flips(299, len(model.blocks), 1)
        return prepared, model, find_dependence(prepared, {"before": model}, layout.folds, flips)

    return find


def test_residual_that_depends_on_position_is_attributed_to_it(record, dependence_of):
    def bump(t, q, v, a, rng):
        return np.column_stack([4.0 * np.exp(-((q[:, 0] - 0.2) ** 2) / 0.02), np.zeros(len(t))])

    _, _, table = dependence_of(record(extra_torque=bump, runs=4))
    a = table[table["joint"] == "a"].sort_values("share_held_out", ascending=False)
    assert a["signal"].iloc[0] == "q_a"
    assert a["share_held_out"].iloc[0] > 0.4
    assert a["p_adjusted"].iloc[0] < 0.01
    other = table[table["joint"] == "b"]
    assert other["p_adjusted"].min() > 0.01
    assert other["share_held_out"].max() < 0.05


def test_white_residual_depends_on_nothing_and_is_white(record, dependence_of):
    prepared, model, table = dependence_of(record(runs=4))
    assert table["p_adjusted"].min() > 0.01
    assert (table["share_held_out"] < 0.05).all()
    whiteness = diagnose_residuals(prepared, predict_runs(prepared, model, model))
    assert (whiteness["ljung_box_p"] > 1e-3).all()
    assert (whiteness["lag_correlation"].abs() < 0.3).all()


def test_coloured_residual_is_not_white(record, fit_declared):
    def drift(t, q, v, a, rng):
        return np.outer(8.0 * np.sin(2 * np.pi * 0.7 * t), [1.0, 1.0])

    prepared, _, model = fit_declared(record(runs=3, extra_torque=drift))
    table = diagnose_residuals(prepared, predict_runs(prepared, model, model))
    assert (table["ljung_box_p"] < 1e-6).all()
    assert np.allclose(table["peak"], 0.7, atol=0.2)


def test_black_box_finds_a_planted_interaction_and_no_noise():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, (3000, 4))
    chosen = np.arange(3000) >= 2000
    y = 2.0 * x[:, 0] * x[:, 2] + 0.1 * rng.standard_normal(3000)
    fresh = rng.uniform(-1, 1, (1000, 4))
    model = fit_black_box(x, y, chosen)
    left = 2.0 * fresh[:, 0] * fresh[:, 2] - model.predict(fresh)
    assert np.std(left) < 0.3 * np.std(2.0 * fresh[:, 0] * fresh[:, 2])
    noise = fit_black_box(x, rng.standard_normal(3000), chosen)
    assert noise is None or noise.n_iter_ <= 3


def test_black_box_on_runs_sees_what_no_named_signal_has(record, fit_declared):
    def product(t, q, v, a, rng):
        return np.column_stack([8.0 * np.tanh(4 * q[:, 0] * v[:, 1]), np.zeros(len(t))])

    prepared, _, model = fit_declared(record(runs=4, extra_torque=product))
    table = judge_black_box(prepared, predict_runs(prepared, model, model)).set_index(["joint", "stage"])
    assert table.loc[("a", "before"), "share_removed"] > 0.3
    assert table.loc[("b", "before"), "share_removed"] < 0.1
    low, high = table.loc[("a", "before"), ["rms_black_box_low", "rms_black_box_high"]]
    assert low < table.loc[("a", "before"), "rms_black_box"] < high


def models_of(prepared, model):
    made = estimate(model)
    return {stage: make_corrected_model(prepared, model, made, stage) for stage in ("before", "after")}


def test_failed_simulation_is_said_and_leaves_no_numbers(record, fit_declared, monkeypatch):
    prepared, _, model = fit_declared(record(runs=2, duration=6.0))
    models = models_of(prepared, model)

    def fail(simulated, *args, **kwargs):
        raise SimulationError(f"{simulated.name} fell over.")

    monkeypatch.setattr("wearscope.simulation.forward.simulate_forward", fail)
    summary, series = forward.compare_forward(prepared, models)
    assert summary["outcome"].str.contains("fell over").all()
    assert summary[["torque_rms", "motion_rms", "torque_rms_low"]].isna().all(axis=None)
    assert series["simulated_after"].isna().all()
    assert np.isfinite(series["measured"]).all()


def test_whole_examination_on_a_small_data_set(record, tmp_path):
    spring = [(1, "joint_spring", {"stiffness": 10.0, "preload": 2.0})]
    folder = record(planted=spring, runs=4, duration=10.0, rate=100.0)
    out = tmp_path / "out"
    said = []
    verdict = close_loop(folder, out, policy=Policy(flips=499), progress=said.append)
    tables = {path.stem for path in out.glob("*.parquet")}
    expected = {
        "signals",
        "isolability",
        "diagnostics",
        "dependence",
        "black_box",
        "forward",
        "forward_series",
        "profiles",
    }
    assert tables == expected | {"residual", "candidates"}
    assert json.loads((out / "verdict.json").read_text()) == verdict
    assert any("forward simulation" in line for line in said)
    residual, signals = (pd.read_parquet(out / f"{name}.parquet") for name in ("residual", "signals"))
    pd.testing.assert_frame_equal(residual[["t", "run", "joint"]], signals[["t", "run", "joint"]])

    # Simulated forward, the corrected model is closer in torque and in motion, where the spring is.
    b = verdict["forward"]["b"]
    assert b["before"]["outcome"] == b["after"]["outcome"] == "ok"
    assert b["after"]["torque_rms"] < 0.5 * b["before"]["torque_rms"]
    assert b["after"]["motion_rms"] < 0.6 * b["before"]["motion_rms"]
    # The simulator says what the regression says.
    joint = verdict["joints"]["b"]
    assert b["before"]["torque_rms"] == pytest.approx(joint["rms_before"], rel=0.1)
    assert b["after"]["torque_rms"] == pytest.approx(joint["rms_after"], abs=0.1 * joint["rms_before"])
    assert verdict["black_box"]["b"]["before"]["share_removed"] > 0.5


def test_residual_of_a_joint_that_stands_still_is_not_described(record, fit_declared):
    prepared, _, model = fit_declared(record(runs=2, duration=6.0))
    whole = predict_runs(prepared, model, model)
    still = [Predicted(p.run, p.declared, p.before, p.after) for p in whole]
    for p in still:
        p.run.keep[:, 1] = False
    table = diagnose_residuals(prepared, still)
    b = table[table["joint"] == "b"]
    assert b[["rms", "relative_error", "peak", "ljung_box_p"]].isna().all(axis=None)
    assert np.isfinite(table.loc[table["joint"] == "a", "rms"]).all()
