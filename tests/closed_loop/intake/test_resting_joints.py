"""Runs in which one joint moves at a time, with encoders of a count of 1e-4 rad, are as good as any."""

import numpy as np
import pandas as pd
import pytest
from changed_fields import changed_fields
from folders import change_runs, check, read_prepared

from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.cleaning import clean_run
from wearscope.closed_loop.intake.recording import Run, estimate_quantum
from wearscope.closed_loop.run import close_loop
from wearscope.errors import InputError
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.urdf import normalise_urdf

COUNT, RATE, DURATION = 1e-4, 125.0, 16.0


def move_one(rng, t, start, stop):
    """Position, speed and acceleration of a joint that moves from `start` to `stop` only, smoothly."""
    u = np.clip((t - start) / (stop - start), 0.0, 1.0)
    window, slope = np.sin(np.pi * u) ** 4, 4 * np.sin(np.pi * u) ** 3 * np.cos(np.pi * u) * np.pi
    curve = 4 * np.pi**2 * (3 * np.sin(np.pi * u) ** 2 * np.cos(np.pi * u) ** 2 - np.sin(np.pi * u) ** 4)
    slope, curve = slope / (stop - start), curve / (stop - start) ** 2
    w, phase = rng.uniform(2.0, 4.0), rng.uniform(0, 6)
    x, dx, ddx = np.sin(w * t + phase), w * np.cos(w * t + phase), -(w**2) * np.sin(w * t + phase)
    return window * x, slope * x + window * dx, curve * x + 2 * slope * dx + window * ddx


def rewrite(folder, make, payload=None):
    """Put other recordings in: `make(rng, t, body)` gives positions and torques without rotors (N, 2)."""
    t = np.arange(int(DURATION * RATE)) / RATE
    with changed_fields(folder / "dataset.yaml") as fields:
        fields["sample_rate"] = RATE
        joints = fields["robot"]["joints"]
        body = RigidBody(normalise_urdf((folder / "robot.urdf").read_text(), joints), joints, payload=payload)
        for r, run in enumerate(fields["runs"]):
            if payload is None:
                run.pop("payload", None)
            q, a, tau = make(np.random.default_rng(r), t, body)
            signals = {"q": q, "tau": tau + np.array(fields["robot"]["rotor_inertia"]) * a}
            columns = {f"{kind}_{j}": x[:, k] for kind, x in signals.items() for k, j in enumerate(joints)}
            pd.DataFrame({"t": t} | columns).to_parquet(folder / run["file"], index=False)
    return folder


@pytest.fixture
def one_by_one(record):
    """The fixture's arm, moved joint by joint; held joints toggle by a count and carry what they like."""

    def move(rng, t, body):
        parts = [move_one(rng, t, 8.0 * k + 0.5, 8.0 * k + 7.5) for k in range(2)]
        q, v, a = (np.column_stack([part[k] for part in parts]) for k in range(3))
        q = q + rng.uniform(-0.5, 0.5, 2)
        stuck = np.where(np.abs(v) < 1e-6, 0.5 * np.sin(0.2 * t)[:, None], np.sign(v))
        tau = body.inverse_dynamics(q, v, a) + np.array([6.0, 3.0]) * stuck + 3.0 * v
        tau += 0.3 * rng.normal(size=q.shape)
        toggling = np.where((rng.random(q.shape) < 0.02) & (v == 0), COUNT, 0.0)
        return np.round(q / COUNT) * COUNT + toggling, a, tau

    def make(resampled):
        folder = rewrite(record(runs=3, duration=2.0), move, Payload(3.0, (0.3, 0, 0)))
        if resampled:
            late = lambda table, x: np.interp(table["t"] + 0.37 / RATE, table["t"], x)  # noqa: E731
            change_runs(folder, lambda table: table.apply(lambda x: late(table, x)))
        return folder

    return make


@pytest.mark.parametrize("resampled", [False, True], ids=["counts", "interpolated"])
def test_joint_by_joint_runs_are_believed(one_by_one, resampled):
    prepared = check(one_by_one(resampled))
    assert prepared.moving.all() and not any("spikes" in note or "cut off" in note for note in prepared.notes)
    run = prepared.runs[0]
    first, second = run.t < 7.0, (run.t > 9.0) & (run.t < 15.0)
    assert run.keep[second, 0].mean() < 0.2 < 0.5 < run.keep[first, 0].mean()
    assert run.keep[first, 1].mean() < 0.2 < 0.5 < run.keep[second, 1].mean()


def test_quantum_is_the_encoders_count():
    rng = np.random.default_rng(0)
    t = np.arange(4000) / 250
    q = np.column_stack([np.sin(t), np.round(np.sin(t) / 1e-3) * 1e-3, np.full(4000, 0.2)])
    q[rng.random(4000) < 0.01, 2] += 5e-5
    np.testing.assert_allclose(estimate_quantum(q), [0.0, 1e-3, 5e-5], rtol=1e-6, atol=1e-12)


def test_a_real_step_of_a_resting_joint_is_still_refused():
    t = np.arange(2000) / 250
    q = np.column_stack([np.sin(t), np.where(t < 4.0, 0.2, 0.25)])
    run = Run("r", "train", t, q, np.cos(3 * t)[:, None] * np.ones(2), None, None, None)
    with pytest.raises(
        InputError, match=r"'q_b' steps by 0\.05 .* \"accept: \[step q_b\]\" to dataset\.yaml"
    ):
        clean_run(run, ["a", "b"], "f", reach=np.array([2.0, 1.0]))


def test_what_holds_a_joint_at_rest_changes_no_row_in_which_it_moves(one_by_one):
    """Whatever static friction holds, the filtered torque of the motion before and after is the same."""
    folder = one_by_one(False)
    plain = read_prepared(folder).runs[0]
    path = folder / plain.file
    table = pd.read_parquet(path)
    first = next(name for name in table if name.startswith("tau_"))
    # The first joint moves from 0.5 to 7.5 s, and slowly towards the end: it rests from a little before.
    table.loc[table["t"] >= 7.5, first] += 4.0
    table.to_parquet(path, index=False)
    held = read_prepared(folder).runs[0]
    kept = plain.keep[:, 0] & held.keep[:, 0]
    assert kept.sum() > 50
    np.testing.assert_allclose(held.measured[kept, 0], plain.measured[kept, 0], atol=1e-6)
    # At rest the measured torque stays what it was measured to be.
    still = held.t > 9.5
    np.testing.assert_allclose(held.measured[still, 0] - plain.measured[still, 0], 4.0, atol=0.05)


@pytest.mark.parametrize("held", [0.0, 0.7])
def test_a_joint_that_never_moves_is_not_judged_and_the_others_are(record, tmp_path, held):
    """Its encoder stays at one count in all runs; its torque may be zero, as with brakes on."""

    def move(rng, t, body):
        q, v, a = (np.column_stack([x, np.zeros_like(x)]) for x in move_one(rng, t, 0.5, 15.5))
        q[:, 1] = 0.3
        tau = body.inverse_dynamics(q, v, a)
        tau[:, 0] += 6.0 * np.sign(v[:, 0]) + 3.0 * v[:, 0] + 40.0 * q[:, 0]
        tau += 0.3 * rng.normal(size=q.shape)
        tau[:, 1] = held
        return q, a, tau

    folder = rewrite(record(runs=4, duration=10.0), move)
    verdict = close_loop(folder, tmp_path / "out", policy=Policy(flips=499))
    assert verdict["joints"]["b"]["state"] == "not_judged"
    (named,) = verdict["verdict"]
    assert named["joint"] == "a"
    assert {"joint_spring", "gravity_counterbalance"} & {named["effect"], *named["equivalent"]}
    assert (tmp_path / "out" / "model_after.yaml").is_file()
