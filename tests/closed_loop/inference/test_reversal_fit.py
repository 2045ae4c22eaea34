"""Friction's reversal, fitted with the model: its width is recovered, and its form is given no name."""

import numpy as np
import pytest
from folders import fit_problem

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.answer import find_terms
from wearscope.closed_loop.inference.laws import refine_reversals
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.direction import Reversals, soften_direction, vary_direction
from wearscope.closed_loop.model.estimation import estimate, estimate_jointly

WIDTHS = np.array([0.12, 0.05])
FORMS = {
    "tanh": np.tanh,
    "algebraic": lambda x: x / np.sqrt(1.0 + x**2),
    "arctangent": lambda x: 2.0 / np.pi * np.arctan(0.5 * np.pi * x),
}


def soften(form, curved=0.0):
    """Torque that turns the generator's abrupt Coulomb friction into a smooth one."""

    def torque(t, q, v, a, rng):
        level = np.array([6.0, 3.0])
        smooth = level * (FORMS[form](v / WIDTHS) - np.sign(v))
        return smooth + np.array([curved, 0.0]) * v * np.abs(v)

    return torque


@pytest.fixture(scope="module")
def curved(record_at, pose, tmp_path_factory):
    """Smooth friction with churning losses that nobody declared, and little noise."""
    folder = tmp_path_factory.mktemp("curved") / "duo"
    return pose(record_at(folder, noise=0.05, extra_torque=soften("tanh", curved=2.0), seed=3, runs=3))


@pytest.mark.parametrize("wrong", [0.0, 0.6, 1.6])
def test_the_width_is_recovered_beside_a_model_that_lacks_something(curved, declared_model, wrong):
    model = declared_model(curved.reverse_over(Reversals.over(wrong * WIDTHS)))
    widths = refine_reversals(model.problem.prepared, model.fit).width
    # The second joint lacks nothing; the first lacks a drag that has no part in its reversal.
    assert widths[1] == pytest.approx(WIDTHS[1], rel=0.05)
    assert widths[0] == pytest.approx(WIDTHS[0], rel=0.25)


def test_the_width_is_recovered_once_what_was_missing_is_named(curved):
    answer = find_terms(curved, Policy())
    assert [(f.term.effect.name, f.term.joint) for f in answer.found] == [("quadratic_viscous", 0)]
    assert answer.problem.prepared.reversals.width == pytest.approx(WIDTHS, rel=0.03)


def test_a_reversal_at_once_stays_one(record, pose, declared_model):
    problem = pose(record(noise=0.05, seed=11)).reverse_over(Reversals.over(np.zeros(2)))
    fitted = refine_reversals(problem.prepared, declared_model(problem).fit)
    assert fitted.width.max() < 0.01 * WIDTHS.min()


@pytest.mark.parametrize("form", FORMS)
def test_the_form_is_found_and_friction_far_from_the_reversal_is_in_its_interval(record, form):
    declared = ("rigid_body", "rotor_inertia")
    folder = record(noise=0.05, extra_torque=soften(form), seed=5, runs=3, declared=declared)
    found = diagnose(folder)
    assert found.prepared.reversals.form.tolist() == [list(FORMS).index(form)] * 2
    stated = {(e["joint"], e["effect"]): e["parameters"] for e in found.verdict["verdict"]}
    for joint, level in (("a", 6.0), ("b", 3.0)):
        low, high = stated[joint, "coulomb"]["level"]["ci95"]
        assert low <= level <= high
        assert high - low < 0.2 * level


def test_where_the_forms_cannot_be_told_apart_the_interval_is_wide(record_at, tmp_path):
    """In noise the form stays the first one, and what another one would make of friction is said."""
    widths = []
    for noise in (0.05, 3.0):
        folder = record_at(
            tmp_path / f"noise{noise:g}", noise=noise, extra_torque=soften("arctangent"), seed=6,
            declared=("rigid_body", "rotor_inertia"),
        )  # fmt: skip
        stated = {(e["joint"], e["effect"]): e["parameters"] for e in diagnose(folder).verdict["verdict"]}
        low, high = stated["a", "coulomb"]["level"]["ci95"]
        assert low <= 6.0 <= high
        widths.append(high - low)
    assert widths[1] > 3.0 * widths[0]


@pytest.mark.parametrize(("width", "told"), [(0.02, True), (0.1, False)])
def test_a_level_that_another_form_would_take_away_is_not_told_from_zero(record, pose, width, told):
    """Bent friction, taken for plain friction that reverses slowly: its interval holds zero."""

    def bend(t, q, v, a, rng):
        bent = np.sign(v[:, 0]) * (2.0 * np.sqrt(np.abs(v[:, 0])) - 5.0)
        return np.column_stack([bent, 0.0 * bent])

    problem = pose(record(noise=0.05, extra_torque=bend, seed=6))
    problem = problem.reverse_over(Reversals.over(np.array([width, WIDTHS[1]])))
    model = fit_problem(problem)
    at = next(k for k, e in enumerate(model.entries) if (e.effect.name, e.joint) == ("coulomb", 0))
    joint, one = estimate_jointly(model, conditional=True), estimate(model, conditional=True)[at]
    level, half, moved = (x[model.spans[at].start] for x in (joint.theta, joint.width, joint.moved))
    assert level > half - moved
    low, high = one.intervals["level"]
    assert (low > 0.0 or high < 0.0) == told
    assert (one.sureness > 1.0) == told


@pytest.mark.parametrize("form", FORMS)
def test_the_form_of_a_reversal_is_given_no_name(record, form):
    folder = record(noise=0.05, extra_torque=soften(form), seed=5, runs=3)
    assert diagnose(folder).verdict["verdict"] == []


@pytest.mark.slow
def test_a_stribeck_friction_is_named_beside_a_smooth_reversal(record):
    def torque(t, q, v, a, rng):
        bump = 6.0 * np.exp(-((v[:, 0] / 0.6) ** 2)) * np.tanh(v[:, 0] / WIDTHS[0])
        return soften("tanh")(t, q, v, a, rng) + np.column_stack([bump, 0.0 * bump])

    (entry,) = diagnose(record(noise=0.3, extra_torque=torque, seed=7)).verdict["verdict"]
    assert (entry["joint"], entry["effect"]) == ("a", "stribeck")


def test_what_a_reversal_may_change_is_the_difference_of_its_forms():
    v = np.linspace(-1.0, 1.0, 401)
    sign = np.sign(v)
    wider, algebraic, arctangent = vary_direction(v, 0.1, sign).T
    now = soften_direction(v, 0.1, sign)
    by_width = (soften_direction(v, 0.1 * np.exp(1e-5), sign) - now) / 1e-5
    assert wider == pytest.approx(by_width, abs=1e-4)
    assert now + algebraic == pytest.approx(v / np.hypot(v, 0.1), abs=1e-12)
    # All have the same slope at the reversal and the same friction far from it.
    assert now + arctangent == pytest.approx(2 / np.pi * np.arctan(np.pi * v / 0.2), abs=1e-12)
    assert not vary_direction(v, 0.1, 0.0 * v).any()
    assert not vary_direction(v, 0.0, sign).any()


def test_a_thinned_run_reverses_as_one_that_was_made_so(record, pose):
    prepared = pose(record(rate=1000.0, runs=2, duration=8.0)).prepared
    run = prepared.runs[0]
    assert run.factor > 1
    again = prepared.reverse_over(Reversals.over(WIDTHS)).reverse_over(prepared.reversals).runs[0]
    moving = run.reduce(run.signals.sign)
    assert np.abs(run.reduce(again.signals.sign) - moving).max() < 0.02


@pytest.mark.parametrize("form", range(len(FORMS)))
def test_forms_stand_in_the_same_order_everywhere(form):
    v = np.linspace(-1.0, 1.0, 400)
    one = Reversals(np.array([0.1]), np.array([form]))
    direction = one.soften(v[:, None], np.sign(v)[:, None])[:, 0]
    assert direction == pytest.approx(list(FORMS.values())[form](v / 0.1), abs=1e-12)
    for step in (1, 2):
        other = one.change_form(step)
        at_half = (
            np.interp(0.5, direction, v),
            np.interp(0.5, other.soften(v[:, None], np.sign(v)[:, None])[:, 0], v),
        )
        assert at_half[0] == pytest.approx(at_half[1], rel=1e-2)
        assert one.differ(other).all()
    assert not one.differ(one.change_form(3)).any() or one.change_form(3).width == pytest.approx(one.width)
