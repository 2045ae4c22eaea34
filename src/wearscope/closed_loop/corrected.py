"""The corrected model that a user takes away: never worse than the declared one on the test runs.

Training runs alone choose and fit. A correction that held-out training runs bear out can still be wrong
elsewhere, as at another temperature, and only test runs show it. They therefore have a veto and no vote: a
name that they refute, or that makes a joint's error larger, is taken out, and the joint goes back towards the
declared model, which claims nothing. By such a veto no test run counts twice for one claim:

- A name is `confirmed` where the whole interval of what it removes at its joints is above zero. The veto
  makes no false confirmation likelier.
- An error is called `smaller` only where the interval of its change lies below zero. That the smaller of
  two errors is taken favours the corrected model, but is not enough for this word.

If some test runs decided and others reported, both would be less sure, and the error could still be larger
on those that report.

Bodies couple the joints. A name that lowers a joint's noise gives this joint more weight in the fit of the
bodies that it shares with others. What that changes at another joint is no reason against the name. The few
parameters of a named body may not fit all joints: a payload without moments of inertia turns a distant axis
too easily. A joint that a named body harms is given an inertia of its own before the body's name is
withdrawn.
"""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.inference.status import SAME, Marked
from wearscope.closed_loop.intake.prepared import Prepared, known_inertia
from wearscope.closed_loop.model.possible import Impossible, keep_possible, list_beyond
from wearscope.closed_loop.model.prediction import bootstrap_change, predict_reduced, refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.rotor_inertia_error import EFFECT as OWN_INERTIA

_SEED = 31


def withdraw_worse(
    base: Regression,
    before: Regression,
    sigma: np.ndarray,
    terms: Sequence[ModelTerm],
    marked: Sequence[Marked],
) -> tuple[Regression, list[str], list[Impossible], list[ModelTerm]]:
    """The corrected model without names that the test runs refute or that make a joint's error larger.

    Parameters
    ----------
    base : Regression
        The declared model with all its coefficients.
    before : Regression
        The same with those that are possible.
    sigma : ndarray (n,)
        Residual scale of the model with all names.
    terms : sequence of ModelTerm
    marked : sequence of Marked
        What the test runs say of each.

    Returns
    -------
    Regression
        `before` itself where no name is left.
    list of str
        Why each name is not in it; empty where it is.
    list of Impossible
        What the fit of the declared effects with the names left out.
    list of ModelTerm
        Inertias of joints that a named body would harm; they are no names.
    """
    why = ["the test runs refute it" if mark.status == "refuted" else "" for mark in marked]
    kept = [k for k, reason in enumerate(why) if not reason]
    helped: list[ModelTerm] = []
    start = Regression(base.prepared, base.entries, sigma, base.inertial, base.blocks)
    while kept:
        model = refit(start, [*base.entries, *helped, *(terms[k] for k in kept)])
        model, out = keep_possible(model, len(base.entries))
        first = len(model.entries) - len(kept)
        impossible = [kept[i - first] for i, *_ in list_beyond(model)]
        here = {k: terms[k] for k in kept}
        worst = (-1, impossible, 0.0) if impossible else _find_worse(base.prepared, before, model, here)
        j, worse, growth = worst
        if not worse and all(_is_possible(model, term) for term in helped):
            return model, why, out, helped
        inertia = ModelTerm(OWN_INERTIA, j, (), (0,))
        spread = j >= 0 and all(terms[k].effect.spread for k in worse)
        if spread and inertia not in helped:
            helped.append(inertia)
            continue
        # The effect that removes least of the test runs' error is withdrawn first.
        gone = min(worse or kept, key=lambda k: np.nan_to_num(marked[k].reduction))
        kept.remove(gone)
        larger = f"it makes the test runs' error of {base.prepared.dataset.joints[j]} {growth:.2g} % larger"
        why[gone] = larger if worse and j >= 0 else "parameters of the model would be impossible with it"
        helped = []
    return before, why, [], []


def _is_possible(model: Regression, term: ModelTerm) -> bool:
    """Whether a drive has an inertia left with what a term adds to the declared one."""
    span = model.spans[model.entries.index(term)]
    return bool(known_inertia(model.prepared.dataset)[term.joint] + model.solve()[span][0] >= 0.0)


def _find_worse(
    prepared: Prepared, before: Regression, after: Regression, kept: dict[int, ModelTerm]
) -> tuple[int, list[int], float]:
    """The joint whose error grows most by names that act on it, these names, and by how many per cent.

    Where none but names of bodies acts on it, it must be worse outside the noise.
    """
    errors = []
    for model in (before, after):
        theta = model.solve()
        test = prepared.runs_for("test")
        left = [run.measured - predict_reduced(model, theta, run) for run in test]
        errors.append([(e, r.keep) for r, e in zip(test, left, strict=True)])
    change, interval = bootstrap_change(errors[0], errors[1], max(4, int(4 * prepared.band.torque)), _SEED)
    for j in np.argsort(-np.nan_to_num(change)).tolist():
        if not change[j] > 100.0 * SAME:
            return -1, [], 0.0
        own = [k for k, term in kept.items() if term.joint == j and not term.effect.spread]
        felt = [k for k, term in kept.items() if term.effect.spread]
        if own:
            return j, own, float(change[j])
        if felt and interval[0][j] > 0.0:
            return j, felt, float(change[j])
    return -1, [], 0.0
