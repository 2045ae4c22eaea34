"""Models drawn from what the loop leaves open: as wide as the intervals, as tied as the data make them."""

import dataclasses

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.model.correction import estimate_torque_noise
from wearscope.closed_loop.model.estimation import draw_parameters, estimate, estimate_jointly
from wearscope.closed_loop.run import close_loop, draw_models
from wearscope.robots.friction import find_lacking
from wearscope.robots.model import load_model

SPRING = {"stiffness": 12.0, "preload": 3.0}
NOISE = np.array([1.0, 0.5])


@pytest.fixture(scope="module")
def folder(record_at, tmp_path_factory):
    return record_at(tmp_path_factory.mktemp("drawn") / "duo", [(1, "joint_spring", SPRING)], runs=3)


@pytest.fixture(scope="module")
def found(folder):
    return diagnose(folder, Policy(flips=499))


def test_the_torque_s_noise_is_that_recorded(found):
    np.testing.assert_allclose(
        estimate_torque_noise([run.tau for run in found.prepared.runs]), NOISE, rtol=0.05
    )
    np.testing.assert_allclose(found.models["after"].torque_noise, NOISE, rtol=0.05)


def test_draws_fill_the_intervals(found):
    joint = estimate_jointly(found.after)
    drawn = draw_parameters(found.after, joint, np.random.default_rng(1), 1500)
    for i, one in enumerate(estimate(found.after)):
        for name, (low, high) in one.intervals.items():
            values = np.array([named[i][name] for _, named in drawn])
            assert np.mean((values >= low) & (values <= high)) == pytest.approx(0.95, abs=0.03)
            assert np.median(values) == pytest.approx(one.values[name], abs=0.1 * (high - low))


def test_draws_keep_what_the_data_tie_together(found):
    """Coulomb and viscous friction trade: their sum at a middle speed is better known than either is."""
    joint = estimate_jointly(found.after)
    thetas = np.array(
        [theta for theta, _ in draw_parameters(found.after, joint, np.random.default_rng(2), 3000)]
    )
    p = found.after.p
    expected = joint.covariance[:p, :p] / np.sqrt(np.outer(*[np.diag(joint.covariance)[:p]] * 2))
    np.testing.assert_allclose(np.corrcoef(thetas.T), expected, atol=0.08)


def test_drawn_models_have_the_model_s_effects_or_their_equivalents(found):
    models = list(draw_models(found, "after", 3, 5))
    own = [(entry.joint, entry.effect) for entry in found.models["before"].effects]
    (named,) = found.attributions
    tied = {named.term.effect.name, *named.equivalent}
    for model in models:
        drawn = [(entry.joint, entry.effect) for entry in model.effects]
        assert drawn[:-1] == own and drawn[-1][0] == "b" and drawn[-1][1] in tied
        assert find_lacking(model)
    again = list(draw_models(found, "after", 3, 5))
    assert [m.effects for m in again] == [m.effects for m in models]
    assert models[0].effects != models[1].effects
    (before,) = draw_models(found, "before", 1, 5)
    assert [(entry.joint, entry.effect) for entry in before.effects] == own


def test_names_that_cannot_be_told_apart_are_drawn_as_often(found):
    """Of two names, half the models have each; a model of the other name has its parameters refitted."""
    (named,) = found.attributions
    names = ["joint_spring", "gravity_counterbalance"]
    others = [name for name in names if name != named.term.effect.name]
    assert len(others) == 1
    two = dataclasses.replace(found, attributions=[dataclasses.replace(named, equivalent=others)])
    drawn = [model.effects[-1] for model in draw_models(two, "after", 40, 3)]
    springs = [entry for entry in drawn if entry.effect == "joint_spring"]
    assert {entry.effect for entry in drawn} == set(names)
    assert 10 < len(springs) < 30
    stiffness = [entry.parameters["stiffness"] for entry in springs]
    assert np.mean(stiffness) == pytest.approx(SPRING["stiffness"], rel=0.15)


def test_the_loop_writes_its_drawn_models(folder, tmp_path):
    close_loop(folder, tmp_path, light=True, policy=Policy(flips=499), draws=2)
    files = sorted(path.name for path in (tmp_path / "drawn").glob("*.yaml"))
    assert files == ["after-01.yaml", "after-02.yaml", "before-01.yaml", "before-02.yaml"]
    own, drawn = (load_model(tmp_path / name) for name in ("model_after.yaml", "drawn/after-01.yaml"))
    assert own.joints == drawn.joints and own.effects != drawn.effects
