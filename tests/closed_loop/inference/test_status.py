"""What test runs say of a term that training runs have: confirmed, not confirmed, refuted."""

from dataclasses import replace

import numpy as np
import pytest
from folders import change_runs, fit_problem

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.status import mark_terms
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect

RIPPLE = ModelTerm(load_effect("torque_ripple"), 0, (20.0,), (0, 1))
ELSEWHERE = ModelTerm(load_effect("torque_ripple"), 1, (17.0,), (0, 1))


@pytest.fixture
def tested(record):
    """A ripple in the training runs, and `factor` times that in the test run, as if it had changed phase."""

    def make(factor):
        planted = {"cosine": 1.0, "sine": 0.8, "wavenumber": 20.0}
        folder = record([(0, "torque_ripple", planted)], seed=3, runs=4, duration=8.0)
        ripple = lambda q: (factor - 1.0) * (np.cos(20.0 * q) + 0.8 * np.sin(20.0 * q))  # noqa: E731
        change_runs(folder, lambda x: x.assign(tau_a=x["tau_a"] + ripple(x["q_a"])), use="test")
        return folder

    return make


@pytest.fixture
def mark(pose):
    def marks(folder, *terms):
        problem = pose(folder)
        base = fit_problem(problem)
        after = refit(base, [*base.entries, *terms])
        before = after.solve().copy()
        marked = mark_terms(problem.prepared, after, after.entries[len(base.entries) :])
        np.testing.assert_array_equal(after.solve(), before)
        return marked

    return marks


@pytest.mark.parametrize(("factor", "status"), [(1.0, "confirmed"), (-1.0, "refuted")])
def test_a_term_that_the_test_run_has_or_has_the_other_way_round(tested, mark, factor, status):
    (marked,) = mark(tested(factor), RIPPLE)
    assert marked.status == status
    low, high = marked.interval
    assert low < marked.reduction < high
    assert (low > 0.0) if status == "confirmed" else (high < 0.0)


def test_the_reduction_is_that_of_explicit_refits(tested, pose, mark):
    folder = tested(1.0)
    (marked,) = mark(folder, RIPPLE)
    problem = pose(folder)
    base = fit_problem(problem)
    (test,) = problem.prepared.runs_for("test")
    losses = []
    for model in (base, refit(base, [*base.entries, RIPPLE])):
        x = np.concatenate(
            [run.reduce(e.columns(run.signals)) for run in [test] for e in model.entries], axis=2
        )
        left = (test.measured - test.reduce(test.known) - x @ model.solve()) * test.keep
        losses.append(float(np.sum(left[:, 0] ** 2)))
    assert marked.reduction == pytest.approx(1.0 - losses[1] / losses[0], rel=1e-6)


def test_terms_that_neither_has_are_rarely_confirmed_or_refuted(tested, mark):
    """Ripples of many wavelengths at a joint that has none: what is fitted is noise."""
    absent = [replace(ELSEWHERE, shape=(k,)) for k in (11.0, 14.0, 17.0, 23.0, 26.0, 29.0, 33.0, 37.0)]
    marked = mark(tested(1.0), *absent)
    assert [m.status for m in marked].count("not_confirmed") >= 5
    assert all(m.status != "confirmed" or m.reduction < 0.05 for m in marked)


def test_each_term_is_judged_beside_the_others(tested, mark):
    folder = tested(1.0)
    (alone,), (beside, _) = mark(folder, RIPPLE), mark(folder, RIPPLE, ELSEWHERE)
    assert beside.reduction == pytest.approx(alone.reduction, rel=0.01)
    assert mark(folder, RIPPLE) == [alone]


def test_a_refuted_name_stands_first_and_nothing_else_changes(tested, tmp_path):
    """The test run turned round: the same name, parameters and model, said to be refuted."""
    refuted = diagnose(tested(-1.0))
    (entry,) = refuted.verdict["verdict"]
    assert (entry["effect"], entry["status"]) == ("torque_ripple", "refuted")
    assert entry["error_reduction"] < 0.0 and entry["error_reduction_ci95"][1] < 0.0
    assert entry["parameters"]["cosine"]["value"] == pytest.approx(1.0, rel=0.1)
    # It says that the model does not carry over, too.
    assert refuted.verdict["joints"]["a"]["state"] == "unexplained"
