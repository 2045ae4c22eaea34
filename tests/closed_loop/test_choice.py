"""Which of several candidates gives the name, and what stands beside it."""

import numpy as np

from wearscope.closed_loop.regression import Entry
from wearscope.closed_loop.scoring import Scored
from wearscope.closed_loop.trace import TraceOptions, Tracer
from wearscope.effects.base import load_effect


class Tied(Tracer):
    """A tracer that cannot tell any candidates apart."""

    def __init__(self):
        self.options = TraceOptions()

    def passes(self, s, least, alpha):
        return not s.reason

    def stands_out(self, model, s):
        return True

    def tells_apart(self, model, best, other):
        return False


def candidate(name: str, gain: float, shape=(), subset=(0,), joint=0, reason="") -> Scored:
    entry = Entry(load_effect(name), joint, shape, subset)
    one = np.ones(1)
    return Scored(entry, 1.0, gain, gain, one, 0.0, 1.0, np.ones(len(subset)), one, reason=reason)


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
