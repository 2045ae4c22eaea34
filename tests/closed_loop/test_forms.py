"""A small term next to one a hundred times its size: told from that one's form, or not named."""

import numpy as np
import pytest

from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.forms import list_signals
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import load_effect

STRIBECK = (0, "stribeck", {"level": 8.0, "speed": 0.3, "exponent": 1.0})


def find(folder, pose):
    search = Search(pose(folder), Policy())
    return {(f.effect.name, f.joint) for f in find_named(search)}


@pytest.mark.parametrize("size", [10.0, 300.0])
def test_a_small_effect_is_found_beside_a_ripple_of_any_size(record, pose, size):
    """A ripple of the position takes no form that friction has."""
    ripple = (0, "torque_ripple", {"cosine": size, "sine": 0.0, "wavenumber": 15.0})
    found = find(record([STRIBECK, ripple], seed=3, runs=4), pose)
    assert found == {("stribeck", 0), ("torque_ripple", 0)}


@pytest.mark.parametrize("size", [60.0, 400.0])
def test_a_small_effect_is_found_beside_a_coupling_of_any_size(record, pose, size):
    """What the other joint's motion drives takes no form of this joint's."""
    coupling = (0, "cross_coupling", {"coulomb": size, "other": 1})
    found = find(record([STRIBECK, coupling], seed=3, runs=4), pose)
    assert found == {("stribeck", 0), ("cross_coupling", 0)}


def test_the_form_of_a_large_term_is_no_further_term(record, pose):
    """A spring that hardens by a hundredth of its torque is a spring."""

    def harden(t, q, v, a, rng):
        torque = np.zeros_like(q)
        torque[:, 0] = 300.0 * q[:, 0] + 6.0 * np.sign(q[:, 0]) * np.abs(q[:, 0]) ** 1.5
        return torque

    found = find(record(seed=3, runs=4, extra_torque=harden), pose)
    assert found == {("joint_spring", 0)}


def test_a_form_lies_in_curves_of_what_an_effect_depends_on():
    assert list(list_signals(load_effect("torque_ripple"), 2)) == [(0, 2, 0)]
    assert list(list_signals(load_effect("stribeck"), 2)) == [(1, 2, 0), (1, 2, 1)]
    assert None in list(list_signals(load_effect("time_delay"), 2))
    # What another joint drives takes the form of that joint's motion.
    assert list(list_signals(load_effect("cross_coupling"), 2, 1)) == [
        (1, 1, 0),
        (1, 1, 1),
        (2, 1, 0),
        (2, 1, 1),
    ]
