"""Names that motion shows alike: what rests say, with the truth planted, and where static friction holds."""

import numpy as np
import pytest
from folders import fit_problem

from wearscope.closed_loop import diagnosis
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.rests import Left, is_refuted
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect

ROWS, RESTS, APART = 400, 12, 1.0


def left(still, rng, error=0.05):
    """What a name leaves: given torques at rest, noise in motion."""
    forwards = np.arange(RESTS) % 2 == 0
    return Left(np.asarray(still), forwards, error * rng.standard_normal(ROWS), error)


@pytest.fixture
def rng():
    return np.random.default_rng(np.random.SeedSequence(5))


def pair(at_rest, rng, error=0.05):
    """The name that holds nothing at rest, and the one that holds `APART` there; the same in motion."""
    none = left(at_rest, rng, error)
    return none, Left(at_rest - APART, none.forwards, none.moving, error)


def test_torque_at_rest_tells_an_offset_from_an_asymmetry(rng):
    none, offset = pair(APART + 0.05 * rng.standard_normal(RESTS), rng)
    assert is_refuted(none, offset) and not is_refuted(offset, none)
    none, offset = pair(0.05 * rng.standard_normal(RESTS), rng)
    assert is_refuted(offset, none) and not is_refuted(none, offset)


@pytest.mark.parametrize("held", [0.6, 1.0, 3.0])
def test_static_friction_that_keeps_the_direction_says_nothing(rng, held):
    side = np.where(np.arange(RESTS) % 2 == 0, 1.0, -1.0)
    for truth in (0.0, APART):
        none, offset = pair(truth + held * side, rng)
        assert not is_refuted(none, offset) and not is_refuted(offset, none)


def test_static_friction_of_any_size_seldom_says_anything():
    said = 0
    for seed in range(300):
        rng = np.random.default_rng(np.random.SeedSequence([9, seed]))
        # An asymmetry of 1 in a Coulomb level of 2, held anywhere between its ends.
        none, offset = pair(rng.uniform(-1.0, 3.0, RESTS), rng)
        said += is_refuted(none, offset) or is_refuted(offset, none)
    assert said == 0


def test_noise_as_large_as_the_difference_is_averaged_over_many_rests():
    right = wrong = 0
    for seed in range(200):
        rng = np.random.default_rng(np.random.SeedSequence([3, seed]))
        none, offset = pair(0.4 * rng.standard_normal(RESTS), rng, 0.4)
        right += is_refuted(offset, none)
        wrong += is_refuted(none, offset)
    assert right > 80 and wrong == 0


def test_names_that_motion_tells_apart_are_not_asked_at_rest(rng):
    none, offset = pair(APART + 0.05 * rng.standard_normal(RESTS), rng)
    other = Left(offset.still, offset.forwards, offset.moving + 0.5, offset.error)
    assert not is_refuted(none, other)


@pytest.mark.slow
def test_rests_name_the_asymmetry_that_motion_does_not_tell_from_an_offset(tmp_path):
    from benchmarks.board.advice import list_advice_cases
    from benchmarks.board.generate import generate_dataset
    from wearscope.closed_loop.diagnosis import diagnose

    case = list_advice_cases("development", 200, 77)[10]
    generate_dataset(tmp_path / case.name, case.machine, case.planted, case.seed, case.recipe)
    (entry,) = diagnose(tmp_path / case.name).verdict["verdict"]
    assert entry["effect"] == "coulomb_asymmetry" and "torque_offset" not in entry["equivalent"]
    value = entry["parameters"]["half_difference"]
    assert value["ci95"][0] < value["value"] < value["ci95"][1]


@pytest.mark.parametrize(
    ("name", "rival", "asked"), [("coulomb", "cross_coupling", 0), ("torque_offset", "coulomb_asymmetry", 1)]
)
def test_rests_do_not_rename_what_every_drive_has(record, pose, monkeypatch, name, rival, asked):
    """A rest that static friction holds as it turned into it looks like what another joint drives."""
    problem = pose(record(seed=2, declared=("rigid_body", "rotor_inertia"), runs=2, duration=6.0))
    before = fit_problem(problem)
    after = refit(before, [*before.entries, ModelTerm(load_effect(name), 0, (), (0,))])
    rivals = []
    monkeypatch.setattr(
        diagnosis, "settle_at_rest", lambda model, _, one: rivals.extend(one) or (model, [0, 1])
    )
    _, names = diagnosis.settle_rests(problem, after, len(before.entries), [[rival]])
    assert names == [[rival]]
    assert len(rivals) == asked
