"""Two joints that move together in every recording: what one does to the other shows in no run held out."""

from dataclasses import replace

import numpy as np
import pytest

from wearscope.closed_loop.selection import fifths
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.evidence import Refusal, weigh
from wearscope.closed_loop.selection.fifths import weigh_by_fifths
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.stepwise import take

#: Speed of the second joint over the first's in the training runs and the test run.
TOGETHER = (1.0, -1.0, 0.3)
DRAG = 3.0


def drag(t, q, v, a, rng):
    """Viscous friction of the first joint that goes with the second one's speed."""
    return np.column_stack([DRAG * v[:, 1], 0.0 * t])


@pytest.fixture
def search(record, pose):
    """A search along such recordings, of which the last ones are taken where fewer are asked for."""

    def make(seed, torque, runs=3):
        together = TOGETHER[-runs:]
        return Search(pose(record(seed=seed, runs=runs, together=together, extra_torque=torque)), Policy())

    return make


@pytest.mark.parametrize(("seed", "by_fifths", "subset"), [(0, False, (0, 1)), (1, True, (0,))])
def test_what_no_run_predicts_of_another_is_found_by_fifths(search, seed, by_fifths, subset):
    made = search(seed, drag)
    assembly = made.assemble(())
    (offered,) = [c for c in made.candidates(assembly, (), [0]) if c.effect.name == "cross_coupling"]
    weighed = [e for e in made.weigh_all(assembly, [offered]) if e.chosen.subset == (0,)]
    # Each run alone holds the ratio of the two speeds, and little besides.
    (best,) = weighed
    assert best.refusal in (Refusal.IMMATERIAL, Refusal.DISAGREES)
    assert not take(made, assembly, weighed)
    own = max(weigh_by_fifths(made, assembly, weighed), key=lambda e: e.gain)
    assert own.by_fifths and own.agreement == 1.0 and own.informing > 2
    assert min(own.share, own.fitted) >= Policy().beyond_doubt
    (found,) = find_named(made)
    assert (found.effect.name, found.joint) == ("cross_coupling", 0)
    # Both frictions of the coupling together may be what each of these few runs tells of the others.
    assert (found.evidence.by_fifths, found.chosen.subset) == (by_fifths, subset)
    assert found.evidence.beta[0] == pytest.approx(DRAG, abs=0.3)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_nothing_is_found_by_fifths_where_nothing_is(search, seed):
    assert find_named(search(seed, None)) == []


@pytest.mark.parametrize(("runs", "times"), [(2, 0), (3, 1)])
def test_of_a_single_run_nothing_is_asked_again(search, monkeypatch, runs, times):
    """Its parts are held out already; the last of the runs is the test run."""
    asked = []

    def ask(*args, **kwargs):
        asked.append(weigh(*args, **kwargs))
        return asked[-1]

    monkeypatch.setattr(fifths, "weigh", ask)
    made = search(0, drag, runs=runs)
    assembly = made.assemble(())
    first, *_ = made.weigh_all(assembly, made.candidates(assembly, (), [0]))
    weigh_by_fifths(made, assembly, [replace(first, refusal=Refusal.DISAGREES, fitted=1.0, by_fifths=False)])
    assert len(asked) == times
