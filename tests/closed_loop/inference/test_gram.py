"""A model's fit from products by unit is that of its rows; a term more gives the fit of all terms."""

import numpy as np
import pytest

from wearscope.closed_loop.inference.extensions import list_extensions, rank_pairs
from wearscope.closed_loop.inference.gram import Fit, Gram
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.score import Score
from wearscope.closed_loop.inference.splines import PAST, Splines
from wearscope.closed_loop.inference.term import Term
from wearscope.effects.base import load_effect


@pytest.fixture(params=[2, 3, 5], ids=["one run", "two runs", "four runs"])
def model(request, record, pose, declared_model):
    """The declared model with an offset at each joint, on runs that are held out or on fifths of them."""
    given = declared_model(pose(record(seed=3, runs=request.param, duration=6.0)))
    for extension in list_extensions(given, [0, 1], lambda effect, _: effect.is_offset):
        given = given.extend(extension.term)
    return given


def solve(model, rows):
    """Parameters by least squares of all joints' rows, each over its scale."""
    gram, fit = model.problem.gram, model.fit
    x, y = [], []
    for j in range(gram.target.shape[1]):
        count = rows & gram.layout.keep[:, j]
        own = np.zeros((count.sum(), fit.p))
        own[:, fit.at[j]] = fit.columns(j)[count]
        x.append(own / fit.sigma[j])
        y.append(gram.target[count, j] / fit.sigma[j])
    return np.linalg.lstsq(np.concatenate(x), np.concatenate(y), rcond=None)[0]


def test_parameters_are_those_of_least_squares_on_the_rows(model):
    every = np.ones(len(model.problem.target), dtype=bool)
    np.testing.assert_allclose(model.fit.theta, solve(model, every), rtol=1e-6, atol=1e-9)


def test_what_is_held_out_is_predicted_from_the_other_rows(model):
    gram, fit = model.problem.gram, model.fit
    units = gram.layout.units
    losses = np.zeros(2)
    for train, test in zip(units.train, units.test, strict=True):
        theta = solve(model, train[units.of_row] > 0.0)
        held = test[units.of_row] > 0.0
        for j in range(2):
            left = gram.target[:, j] - fit.columns(j) @ theta[fit.at[j]]
            losses[j] += np.sum(left[held & gram.layout.keep[:, j]] ** 2)
    np.testing.assert_allclose(fit.held_out, losses, rtol=1e-6)
    for j in range(2):
        left = fit.leave_held_out(j) * gram.layout.keep[:, j]
        assert np.sum(left**2) == pytest.approx(losses[j], rel=1e-6)


def is_well_determined(model, term):
    """Whether the small ridge on a term's columns hardly moves its coefficients."""
    inner = model.fit.add(term.candidate, term.subset).inner[term.shape]
    size = np.sqrt(np.diag(inner))
    return np.linalg.cond(inner / np.outer(size, size)) < 100.0


def test_a_term_more_gives_the_fit_of_all_terms(model):
    every = [o for o in list_extensions(model, [0, 1]) if o.term.candidate.penalty is None]
    extensions = [o for o in every if is_well_determined(model, o.term)][:6]
    assert extensions
    for extension in extensions:
        grown = model.extend(extension.term).fit
        whole = Fit(model.problem.gram, grown.terms, grown.sigma)
        np.testing.assert_allclose(grown.fitted, whole.fitted, rtol=1e-6)
        np.testing.assert_allclose(grown.held_out, whole.held_out, rtol=1e-5)
        removed = np.sum((model.fit.fitted - grown.fitted) * grown.weight)
        assert extension.gain == pytest.approx(removed, rel=1e-4, abs=1e-6)


def test_products_that_are_taken_over_give_the_fit_of_all_terms(model):
    further = list_extensions(model, [0, 1])[0].term
    others = [
        *(model.without(term) for term in model.terms),
        model.has([further, *model.terms[::-1]]),
        model.has(model.terms, sigma=2.0 * model.sigma),
    ]
    for other in others:
        whole = Fit(model.problem.gram, other.fit.terms, other.sigma)
        np.testing.assert_allclose(other.fit.theta, whole.theta, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(other.fit.held_out, whole.held_out, rtol=1e-8)
        for j in range(2):
            np.testing.assert_allclose(other.fit.predict(j), whole.predict(j), rtol=1e-6, atol=1e-9)


def test_pairs_are_ranked_by_what_they_gain_beyond_each_alone(model):
    extensions = list_extensions(model, [0, 1])
    alone, more = {o.term: o.gain for o in extensions}, []
    for one, two in rank_pairs(model, extensions)[:12]:
        grown = model.extend(one).extend(two).fit
        removed = np.sum((model.fit.fitted - grown.fitted) * grown.weight)
        more.append((removed - alone[one] - alone[two]) / np.sqrt(len(one.subset) + len(two.subset)))
    np.testing.assert_allclose(more, sorted(more, reverse=True), rtol=1e-4)
    assert min(more) > 0.0


def test_a_constant_is_a_level_and_what_changes_sign_is_none(model):
    offset = next(t for t in model.terms if t.effect.is_offset)
    assert model.fit.find_level(offset) == pytest.approx(1.0)
    friction = next(t for t in model.fit.terms if t.effect.name == "coulomb" and t.joint == 0)
    keep = model.problem.layout.keep[:, 0]
    column = friction.at_joint(0)[keep, 0]
    share = column.mean() ** 2 / np.mean(column**2)
    assert model.fit.find_level(friction) == pytest.approx(share)
    assert share < 0.2


def test_a_spline_more_gives_the_fit_of_all_terms(model):
    """Its prior is in variances of its joint's residual."""
    splines = Splines(model.problem.prepared, model.problem.joined)
    candidate = next(splines._roughly(0))
    grown = model.extend(Term(candidate, tuple(range(candidate.count)))).fit
    whole = Fit(model.problem.gram, grown.terms, grown.sigma)
    np.testing.assert_allclose(grown.theta, whole.theta, rtol=1e-5, atol=1e-7)


def test_what_the_motion_has_been_has_no_level(model):
    splines = Splines(model.problem.prepared, model.problem.joined)
    score = Score(Policy(structure_share=1e-9), model.problem.gram.layout, model)
    past = [t for t in splines.list_terms(model, 0, score, past=True) if t.effect.name == PAST.name]
    assert past
    for term in past:
        kept = term.at_joint(0)[model.problem.layout.keep[:, 0]]
        assert np.abs(kept.mean(axis=0)).max() < 1e-9


def test_each_product_is_made_once(model, monkeypatch):
    made = []
    multiply = Gram._multiply
    monkeypatch.setattr(Gram, "_multiply", lambda self, *args: made.append(1) or multiply(self, *args))
    problem = model.problem
    candidate = problem.candidate(load_effect("stribeck"), 0)
    first = model.fit.add(candidate, (0,))
    count = len(made)
    assert count
    again = model.rescale().fit.add(candidate, (0,))
    assert len(made) == count
    assert int(np.argmax(first.gain)) == int(np.argmax(again.gain))
