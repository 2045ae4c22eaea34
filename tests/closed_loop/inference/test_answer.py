"""From a model to its names."""

import numpy as np
import pytest

from benchmarks.board.regimes import list_cases
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.answer import _join_parts
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.model.terms import Candidate
from wearscope.effects.base import load_effect


def make(name, joint, subset, *shape):
    effect = load_effect(name)
    rows = np.zeros((4, len(effect.coefficients)))
    return Term(Candidate(effect, joint, (shape,), (joint,), (rows,)), subset)


def test_parts_of_one_effect_are_one_name():
    """Friction and inertia of a coupling are found in turn; another driving joint is another coupling."""
    parts = [
        make("cross_coupling", 2, (2,), 3.0),
        make("coulomb", 2, (0,)),
        make("cross_coupling", 2, (0, 1), 3.0),
        make("cross_coupling", 2, (0,), 1.0),
        make("cross_coupling", 1, (0,), 3.0),
    ]
    told = [(t.effect.name, t.joint, t.subset, t.model_term.shape) for t in _join_parts(parts)]
    assert told == [
        ("cross_coupling", 2, (0, 1, 2), (3.0,)),
        ("coulomb", 2, (0,), ()),
        ("cross_coupling", 2, (0,), (1.0,)),
        ("cross_coupling", 1, (0,), (3.0,)),
    ]


@pytest.mark.slow
def test_a_name_is_judged_next_to_what_depends_on_the_past(tmp_path):
    """A short recording whose noise drifts: without the drift, other names are far more probable."""
    list_cases("development", 200, 7)[159].make(tmp_path / "d")
    verdict = diagnose(tmp_path / "d").verdict
    assert "depends on the past" in verdict["joints"]["j4"]["reason"]
    (entry,) = (one for one in verdict["verdict"] if one["joint"] == "j4")
    assert entry["effect"] == "torque_offset" and "coulomb_asymmetry" in entry["equivalent"]
    assert entry["probability"] > 0.5
