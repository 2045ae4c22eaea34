"""Stated detection limits, and notes on what is too uncertain for a name, against planted torques."""

import numpy as np
import pytest

from wearscope.closed_loop.run import close_loop

LIMIT = "detection_limit_percent"
#: A spring [N m] that is a little too small for a name on the recording that it is added to.
SMALL = 0.45


def add_spring(size):
    """A spring at the first joint with a torque of this size (RMS), run by run."""

    def torque(t, q, v, a, rng):
        line = q[:, 0] - q[:, 0].mean()
        return np.column_stack([size * line / line.std(), 0.0 * line])

    return torque


def names_at(verdict, joint):
    own = [e for e in verdict["verdict"] if e["joint"] == joint]
    return [name for e in own for name in (e["effect"], *e["equivalent"])]


@pytest.mark.parametrize(("runs", "duration", "noise"), [(2, 30.0, 4.0), (3, 9.0, 1.0)])
def test_a_spring_is_named_above_its_limit_and_not_far_below(record_at, tmp_path, runs, duration, noise):
    made = {"seed": 5, "runs": runs, "duration": duration, "noise": noise}
    plain = close_loop(record_at(tmp_path / "plain", **made), tmp_path / "0", light=True)
    assert not names_at(plain, "a")
    own = plain["joints"]["a"]
    size = own[LIMIT]["joint_spring"] / 100.0 * own["torque_rms"]
    told = {}
    for times in (0.4, 2.5):
        folder = record_at(tmp_path / f"{times}", extra_torque=add_spring(times * size), **made)
        told[times] = names_at(close_loop(folder, tmp_path / f"out{times}", light=True), "a")
    assert not told[0.4]
    assert "joint_spring" in told[2.5]


def test_what_is_too_uncertain_for_a_name_is_noted(record_at, tmp_path):
    made = {"seed": 2, "runs": 2, "duration": 8.0, "noise": 4.0}
    notes = {}
    for size in (0.0, SMALL):
        folder = record_at(tmp_path / f"{size}", extra_torque=add_spring(size), **made)
        verdict = close_loop(folder, tmp_path / f"out{size}", light=True)
        assert not verdict["verdict"]
        notes[size] = [note for note in verdict["notes"] if "too uncertain for a name" in note]
    assert not notes[0.0]
    (note,) = notes[SMALL]
    reason = verdict["joints"]["a"]["reason"]
    assert note == f"a: {reason}."
    assert "joint spring" in reason
    assert verdict["joints"]["a"]["state"] == "explained"
