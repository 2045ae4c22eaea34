"""Slopes of the rigid body's torque that are not kept are made again, the same bits."""

import numpy as np

from wearscope.effects import signals as module
from wearscope.effects.base import Signals


class Pair:
    """A rigid body of two coupled joints."""

    def inverse_dynamics(self, q, v, a):
        return np.column_stack([2.0 * a[:, 0] + np.sin(q[:, 1]) * v[:, 0], a[:, 1] + np.cos(q[:, 0])])


def make_signals():
    t = np.arange(200) / 100.0
    q, v, a = (np.column_stack([np.sin(w * t), np.cos(w * t)]) for w in (1.0, 2.0, 3.0))
    body = Pair()
    return Signals(t, q, v, a, np.sign(v), body.inverse_dynamics(q, v, a), q, np.zeros_like(q), body)


def test_slopes_do_not_depend_on_what_is_kept(monkeypatch):
    kept = make_signals()
    every = [kept.load_slopes(joint) for joint in (0, 1, 0)]
    assert every[2] is every[0]
    monkeypatch.setattr(module, "_KEPT", 0)
    last = make_signals()
    again = [last.load_slopes(joint) for joint in (0, 1, 0)]
    assert list(last._slopes) == [0]
    for one, other in zip(every, again, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(every[0][2], np.tile([2.0, 0.0], (200, 1)), atol=1e-5)
