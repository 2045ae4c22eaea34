"""The score on models of a line or two: noise costs, size convinces, memory and forms make it doubt."""

import shutil

import numpy as np
import pytest

from wearscope.closed_loop.inference.extensions import list_extensions
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.score import Score


@pytest.fixture
def weigh(record, pose, declared_model):
    """Nats for the best spring at the first joint, and the score, of recordings made with options."""

    def make(**options):
        model = declared_model(pose(record(**{"seed": 2, "runs": 4, "duration": 10.0} | options)))
        score = Score(Policy(), model.problem.gram.layout, model)
        (extension,) = list_extensions(model, [0], lambda effect, _: effect.name == "joint_spring")
        made = model.extend(extension.term)
        return score.compare(model, made), score, model, made

    return make


def spring(stiffness):
    return {"planted": [(0, "joint_spring", {"stiffness": stiffness, "preload": 0.0})]}


def test_a_spring_that_is_not_there_costs_its_coefficients_and_odds(weigh):
    gain, score, _, made = weigh()
    odds = score.odds(made.terms[-1])
    assert odds == pytest.approx(Policy().name_odds + np.log(made.terms[-1].alternatives))
    assert gain < -odds


def test_a_larger_spring_is_surer(weigh, tmp_path):
    gains = []
    for k, stiffness in enumerate((0.5, 1.0, 4.0)):
        gains.append(weigh(seed=20 + k, **spring(stiffness))[0])
        shutil.rmtree(tmp_path / "duo")
    assert gains == sorted(gains)
    assert gains[-1] > 20.0


def test_the_order_of_two_models_turns_the_sign(weigh):
    gain, score, model, made = weigh(**spring(4.0))
    assert score.compare(made, model) == pytest.approx(-gain)
    assert score.compare(model, model) == 0.0


def test_rows_that_repeat_each_other_are_not_counted_twice(weigh):
    _, score, _, _ = weigh()
    layout = score.layout
    rng = np.random.default_rng(4)
    white = rng.standard_normal(len(layout.keep))
    walk = np.cumsum(white) - np.linspace(0.0, np.sum(white), len(white))
    few, many = (score.count_rows(x, len(x)) for x in (walk, white))
    assert few < 0.2 * many <= Policy().most_rows


def test_small_is_doubted_next_to_a_large_form_of_its_signal_and_a_far_larger_one_of_another(weigh, tmp_path):
    small = spring(1.0)["planted"]
    alone = weigh(planted=small)[0]
    told = {}
    for case, (name, values) in {
        "same signal": ("gravity_counterbalance", {"sine1": 300.0, "cosine1": 100.0}),
        "other signal": ("quadratic_viscous", {"curvature": 60.0}),
        "other signal, a hundred times": ("quadratic_viscous", {"curvature": 6000.0}),
    }.items():
        shutil.rmtree(tmp_path / "duo")
        _, score, model, _ = weigh(planted=[*small, (0, name, values)])
        extensions = list_extensions(model, [0], lambda e, _, n=name: e.name == n)
        with_large = model.extend(next(o.term for o in extensions if len(o.term.subset) < 3))
        (extension,) = list_extensions(with_large, [0], lambda effect, _: effect.name == "joint_spring")
        told[case] = score.compare(with_large, with_large.extend(extension.term))
    assert told["same signal"] < 0.0 < told["other signal"]
    assert told["other signal"] > 0.5 * alone
    # A form error of a percent in the large term would be larger than the spring.
    assert told["other signal, a hundred times"] < 0.0


@pytest.mark.parametrize(("inertia", "is_richer"), [(0.125, True), (0.0, False)])
def test_the_form_of_a_load_is_judged_by_what_the_load_leaves(weigh, inertia, is_richer):
    """A body is exact: its inertia shows next to a mass that explains far more."""
    load = {"mass": 2.0, "moment_x": 0.5, "inertia_yy": inertia, "inertia_zz": inertia}
    _, score, model, _ = weigh(planted=[(1, "payload_error", load)])
    forms = list_extensions(model, [1], lambda effect, _: effect.name == "payload_error")
    plain, full = (model.extend(o.term) for o in sorted(forms, key=lambda o: len(o.term.subset)))
    assert score.compare(model, plain) > 20.0
    gain = score.compare(plain, full)
    assert (gain > 10.0) is is_richer and (gain < 0.0) is not is_richer
