"""Which of several candidates gives the name, and what stands beside it."""

import numpy as np
import pytest

from wearscope.closed_loop.selection.rule import Choice, TraceOptions
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.regression import Entry
from wearscope.closed_loop.run import find_prismatic
from wearscope.closed_loop.selection.evidence import Scored, Scorer
from wearscope.closed_loop.selection.search import Tracer
from wearscope.effects.base import load_effect


class Tied(Choice):
    """One that cannot tell any candidates apart."""

    def __init__(self):
        self.options = TraceOptions()

    def passes(self, s, least, alpha):
        return not s.reason

    def stands_out(self, model, s):
        return True

    def tells_apart(self, model, best, other):
        return False

    def sharpen(self, model, s):
        pass

    def balances(self, s):
        return False


class ByName(Tied):
    """One that tells every effect from every other, but not one form of an effect from another."""

    def tells_apart(self, model, best, other):
        return best.entry.effect is not other.entry.effect


def candidate(name: str, gain: float, shape=(), subset=(0,), joint=0, reason="") -> Scored:
    entry = Entry(load_effect(name), joint, shape, subset)
    one = np.ones(1)
    return Scored(entry, 1.0, gain, gain, one, 0.0, 1.0, np.ones(len(subset)), one, 1.0, reason=reason)


def test_the_simplest_of_those_tied_gives_the_name_and_the_best_stands_beside_it():
    scored = [
        candidate("concave_viscous", 0.6, (0.5,)),
        candidate("quadratic_viscous", 0.4),
        candidate("stribeck", 0.5, (0.3, 1.0)),
        candidate("viscous_asymmetry", 0.35),
        candidate("torque_offset", 0.1),
        candidate("coulomb_asymmetry", 0.5, joint=1),
        candidate("load_dependent_friction", 0.9, reason="outside its physical bounds"),
    ]
    taken, rivals = Tied().choose(None, scored, 0.08)
    assert taken is scored[1]
    # Others that need a searched shape are left out, but for the best.
    assert [s.entry.effect.name for s in rivals] == ["concave_viscous", "viscous_asymmetry"]


def test_nothing_passes_and_nothing_is_named():
    assert Tied().choose(None, [candidate("stribeck", 0.5, (0.3, 1.0), reason="no")], 0.08) == (None, [])


@pytest.mark.parametrize(
    ("gains", "name", "beside"),
    [
        ((0.9993, 0.9990, 0.9991), "joint_spring", ["gravity_counterbalance"]),
        # A name that misses most of what is left is no rival.
        ((0.9999, 0.990, 0.9985), "gravity_counterbalance", []),
    ],
)
def test_a_name_as_simple_that_gains_as_much_stands_beside_it(gains, name, beside):
    """Where only a richer form beats both: which of the two simple ones is meant stays open."""
    richest = candidate("gravity_counterbalance", gains[0], subset=(0, 1, 2, 3, 4))
    plain = candidate("gravity_counterbalance", gains[1], subset=(0, 1))
    spring = candidate("joint_spring", gains[2], subset=(0, 1))
    taken, rivals = ByName().choose(None, [richest, plain, spring], 0.08)
    assert taken is plain or taken is spring
    assert taken.entry.effect.name == name
    assert [s.entry.effect.name for s in rivals] == beside


def test_a_better_candidate_whose_runs_agree_too_little_stands_beside_the_name():
    taken = candidate("stribeck", 0.26, (0.3, 1.0))
    disagrees = "runs do not agree"
    curved = candidate("quadratic_viscous", 0.33, reason=disagrees)
    curved.p_run = 0.004
    chance = candidate("concave_viscous", 0.33, (0.5,), reason=disagrees)
    chance.p_run = 0.2
    weak = candidate("viscous_asymmetry", 0.12, reason=disagrees)
    weak.p_run = 0.004
    absorbed = candidate("torque_offset", 0.33, reason="the declared model absorbs it on these runs")
    absorbed.p_run = 0.004
    assert Tied().choose(None, [taken, curved, chance, weak, absorbed], 0.08) == (taken, [curved])


@pytest.mark.parametrize(
    ("share", "p_block", "p_run", "reason"),
    [
        (0.6, 0.001, 0.01, ""),
        (0.4, 0.001, 0.01, "runs do not agree"),
        (0.6, 0.001, 0.1, "runs do not agree"),
        (0.8, 0.5, 0.001, ""),
        (0.8, 0.5, 0.01, "not significant once all candidates are counted"),
        (0.6, 0.5, 0.001, "not significant once all candidates are counted"),
    ],
)
def test_what_whole_runs_foretell_of_each_other_is_evidence_of_its_own(tracer, share, p_block, p_run, reason):
    """Sizes may differ from run to run, and an effect may lie in a few blocks, where much is foretold."""
    scored = candidate("backlash", share, (1.0,))
    scored.joint_loss, scored.p_block, scored.p_run = tracer.declared[0], p_block, p_run
    assert tracer.choice.passes(scored, 0.08, 0.005) is (reason == "")
    assert scored.reason == reason


@pytest.fixture
def tracer(record):
    """Tracer of a data set with a Stribeck effect between two values of the searched grid."""
    folder = record([(0, "stribeck", {"level": 8.0, "speed": 0.27, "exponent": 1.0})], seed=3)
    return Tracer(prepare(read_dataset(folder, find_prismatic)), TraceOptions())


def test_a_shape_is_taken_from_the_grid_to_its_best_value_and_the_significance_kept(tracer):
    family = next(f for f in tracer.families if f.effect.name == "stribeck" and f.joint == 0)
    on_grid = Scorer(tracer.before, tracer.folds, tracer.flips).score(family)[0]
    gain, speed, p_run = on_grid.cv_gain, on_grid.entry.shape[0], on_grid.p_run
    assert abs(np.log(speed / 0.27)) > 0.1
    tracer.choice.sharpen(tracer.before, on_grid)
    assert on_grid.cv_gain > gain
    assert abs(np.log(on_grid.entry.shape[0] / 0.27)) < abs(np.log(speed / 0.27))
    assert on_grid.p_run == p_run


def test_a_counterbalance_takes_gravity_off_a_joint_that_has_any(tracer):
    body = tracer.prepared.runs_for("train")[0].signals.rigid_body
    lift = body.inverse_dynamics(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 2)))[0, 0]

    def holds_back(size: float) -> bool:
        scored = candidate("gravity_counterbalance", 0.9, subset=(0, 1))
        scored.beta = np.array([0.0, size])
        return tracer.choice.balances(scored)

    assert holds_back(-0.5 * lift)
    assert not holds_back(0.5 * lift)
    assert not tracer.choice.balances(candidate("joint_spring", 0.9, subset=(0, 1)))
    for run in tracer.prepared.runs_for("train"):
        run.signals.rigid_body = body.with_gravity([0.0, 9.81, 0.0])
    assert not holds_back(-0.5 * lift)
    assert not holds_back(0.5 * lift)
