"""Filters without phase, derivatives of known motions, bandwidths that follow the noise, uniform time."""

import numpy as np
import pytest

from wearscope.closed_loop.intake.cleaning import clean_run
from wearscope.closed_loop.intake.clock import resample
from wearscope.closed_loop.intake.filtering import (
    Band,
    choose_motion_cutoff,
    choose_torque_cutoff,
    differentiate,
    differentiate_run,
    low_pass,
    position_noise,
    rows,
)
from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.rough_model import RoughRun, predict_rough
from wearscope.closed_loop.intake.saturation import bridge_torque, find_clipped, goes_beyond
from wearscope.errors import InputError
from wearscope.robots.spatial import unwrap_turns

RATE = 250.0
T = np.arange(int(12 * RATE)) / RATE
FAST = 2 * np.pi * 1.3


def make_run(q, tau=None, t=T, qd=None, temperature=None):
    q = np.column_stack([q]) if q.ndim == 1 else q
    tau = np.cos(3 * t)[:, None] * np.ones(q.shape[1]) if tau is None else tau.reshape(len(t), -1)
    return Run("r.parquet", "train", t, q, tau, qd, temperature, None)


def draw_smooth(rng, highest=3.0):
    """A motion of known bandwidth [Hz]."""
    return sum(
        rng.normal() / k * np.sin(2 * np.pi * k * highest / 8 * T + rng.uniform(0, 6)) for k in range(1, 9)
    )


def test_filter_has_no_phase():
    x = np.random.default_rng(0).normal(size=(len(T), 2))
    forward = low_pass(x, 10.0, RATE)
    backward = low_pass(x[::-1], 10.0, RATE)[::-1]
    middle = slice(200, -200)
    np.testing.assert_allclose(forward[middle], backward[middle], atol=1e-6)
    # A symmetric pulse stays where it is and symmetric.
    pulse = np.zeros((1001, 1))
    pulse[500] = 1.0
    out = low_pass(pulse, 10.0, RATE)[:, 0]
    assert np.argmax(out) == 500
    np.testing.assert_allclose(out, out[::-1], atol=1e-9)


def test_filter_passes_below_and_stops_above_its_cutoff():
    def gain(frequency):
        x = np.sin(2 * np.pi * frequency * T)[:, None]
        y = low_pass(x, 10.0, RATE)
        return y[500:-500].std() / x[500:-500].std()

    assert gain(3.0) == pytest.approx(1.0, abs=1e-3)
    assert gain(10.0) == pytest.approx(0.5, abs=0.01)
    assert gain(30.0) < 1e-3


def test_filter_leaves_the_signal_alone_near_nyquist():
    x = np.random.default_rng(1).normal(size=(500, 1))
    assert low_pass(x, 0.45 * RATE, RATE) is x


def test_derivatives_of_a_sinusoid_are_right():
    run = make_run(0.8 * np.sin(FAST * T))
    motion = differentiate_run(run, RATE, 25.0)
    inner = slice(100, -100)
    speed, acceleration = 0.8 * FAST * np.cos(FAST * T), -0.8 * FAST**2 * np.sin(FAST * T)
    assert np.abs(motion.v[inner, 0] - speed[inner]).max() < 1e-4 * np.abs(speed).max()
    assert np.abs(motion.a[inner, 0] - acceleration[inner]).max() < 1e-4 * np.abs(acceleration).max()


def test_differentiation_is_exact_for_polynomials():
    t = np.arange(40) / 10.0
    x = np.column_stack([t**6 - t**3, 2.0 * t])
    slope = differentiate(x, 10.0)
    np.testing.assert_allclose(slope[3:-3, 0], (6 * t**5 - 3 * t**2)[3:-3], rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(slope[:, 1], 2.0, rtol=1e-10)


def test_given_speeds_are_used_joint_by_joint():
    q = np.column_stack([np.sin(FAST * T), np.sin(FAST * T)])
    qd = np.column_stack([np.full(len(T), np.nan), 3.0 * FAST * np.cos(FAST * T)])
    motion = differentiate_run(make_run(q, np.column_stack([q, q])[:, :2], qd=qd), RATE, 25.0)
    inner = slice(100, -100)
    np.testing.assert_allclose(motion.v[inner, 1], 3.0 * motion.v[inner, 0], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(motion.a[inner, 1], 3.0 * motion.a[inner, 0], rtol=1e-3, atol=0.01)
    assert np.isfinite(motion.v).all() and np.isfinite(motion.a).all()


@pytest.mark.parametrize(("of_position", "of_speed"), [(1e-5, 1e-2), (1e-3, 1e-3)])
def test_the_quieter_of_speed_and_slope_is_used(of_position, of_speed):
    rng = np.random.default_rng(3)
    speed = FAST * np.cos(FAST * T)
    q = np.sin(FAST * T) + of_position * rng.normal(size=len(T))
    qd = speed + of_speed * rng.normal(size=len(T))
    slope, both = (
        differentiate_run(make_run(q, qd=given), RATE, 25.0).v[100:-100, 0] for given in (None, qd[:, None])
    )
    filtered = low_pass(qd[:, None], 25.0, RATE)[100:-100, 0]
    error = [np.std(x - speed[100:-100]) for x in (slope, filtered)]
    np.testing.assert_array_equal(both, slope if error[0] < error[1] else filtered)
    assert max(error) > 3.0 * min(error)


def test_temperature_of_some_joints_stays_unknown_for_the_others():
    temperature = np.column_stack([np.full(len(T), 30.0), np.full(len(T), np.nan)])
    run = make_run(np.column_stack([np.sin(T), np.cos(T)]), temperature=temperature)
    motion = differentiate_run(run, RATE, 25.0)
    assert (motion.temperature[:, 0] == 30.0).all() and np.isnan(motion.temperature[:, 1]).all()
    none = differentiate_run(make_run(np.column_stack([np.sin(T), np.cos(T)])), RATE, 25.0)
    assert np.isnan(none.temperature).all()


def test_noise_density_is_that_of_the_noise():
    sigma = 1e-4
    q = np.sin(FAST * T) + sigma * np.random.default_rng(2).normal(size=len(T))
    density, edge = position_noise(q[:, None], RATE)
    assert density[0] == pytest.approx(2 * sigma**2 / RATE, rel=0.3)
    assert 1.0 < edge[0] < 10.0


def test_motion_cutoff_falls_with_noise_and_stays_above_the_motion():
    rng = np.random.default_rng(3)
    # Moves at constant acceleration: the spectrum falls with the third power of frequency.
    q = np.cumsum(np.cumsum(np.sign(np.sin(2 * np.pi * 0.7 * T)))) / RATE**2

    def choose(sigma):
        return choose_motion_cutoff([make_run(q + sigma * rng.normal(size=len(T)))], RATE)

    clean, noisy = choose(1e-9), choose(1e-3)
    assert 5.0 <= noisy < clean <= RATE / 10


def test_motion_cutoff_survives_a_joint_that_stands_still():
    rng = np.random.default_rng(4)
    q = np.column_stack([draw_smooth(rng) + 1e-4 * rng.normal(size=len(T)), np.zeros(len(T))])
    assert np.isfinite(choose_motion_cutoff([make_run(q)], RATE))


def test_torque_cutoff_is_where_coherence_ends():
    rng = np.random.default_rng(5)
    predicted = low_pass(rng.normal(size=(len(T), 1)), 12.0, RATE)
    measured = predicted + low_pass(0.01 * rng.normal(size=(len(T), 1)), 60.0, RATE)
    cutoff = choose_torque_cutoff([(measured, predicted)], RATE, 100.0)
    assert 10.0 < cutoff < 25.0
    assert choose_torque_cutoff([(rng.normal(size=(len(T), 1)), predicted)], RATE, 100.0) == 4.0


def test_jittered_time_is_resampled_onto_the_true_motion():
    rng = np.random.default_rng(6)
    t = T + rng.uniform(-0.2, 0.2, len(T)) / RATE
    t[0] = T[0]
    run = make_run(np.sin(FAST * t), np.cos(FAST * t), t=t)
    uniform = resample(run, RATE)
    np.testing.assert_allclose(np.diff(uniform.t), 1 / RATE, rtol=1e-9)
    bend = 0.5 * (0.7 / RATE) ** 2 * FAST**2  # of linear interpolation between samples
    assert np.abs(uniform.q[:, 0] - np.sin(FAST * uniform.t)).max() < bend
    assert np.abs(uniform.tau[:, 0] - np.cos(FAST * uniform.t)).max() < bend


def test_uniform_time_is_left_alone_wherever_it_starts():
    run = make_run(np.sin(T), t=T + 1.7e9)
    assert resample(run, RATE) is run


def test_resampling_never_fills_unknown_values():
    t = T * 1.0005
    temperature = np.column_stack([np.full(len(T), 30.0), np.full(len(T), np.nan)])
    run = make_run(np.column_stack([np.sin(t), np.cos(t)]), t=t, temperature=temperature)
    uniform = resample(run, RATE)
    assert len(uniform.t) != len(t) or not np.array_equal(uniform.t, t)
    assert np.isnan(uniform.temperature[:, 1]).all() and np.allclose(uniform.temperature[:, 0], 30.0)


def test_rows_are_four_times_the_cutoff_and_spare_the_edges():
    band = Band(RATE, 30.0, 10.0)
    kept = rows(band, 1000)
    assert kept.step == 6 and kept.start == 25 and kept.stop == 975


def clean(run):
    return clean_run(run, [f"j{k}" for k in range(run.q.shape[1])], "folder/r.parquet")


def test_a_whole_run_is_not_touched():
    rng = np.random.default_rng(7)
    q = draw_smooth(rng) + 1e-4 * rng.normal(size=len(T))
    tau = 5 * np.sign(np.cos(T)) + np.sin(5 * T) + 0.05 * rng.standard_t(3, size=len(T))
    cleaned = clean(make_run(q, tau))
    np.testing.assert_array_equal(cleaned.run.q[:, 0], q)
    np.testing.assert_array_equal(cleaned.run.tau[:, 0], tau)
    assert not cleaned.faulty.any() and cleaned.notes == []


@pytest.mark.parametrize("resolution", [1e-3, 1e-2])
def test_a_coarse_encoder_of_a_creeping_joint_is_no_fault(resolution):
    q = np.round(0.02 * np.sin(0.2 * T) / resolution) * resolution
    cleaned = clean(make_run(np.column_stack([np.sin(T), q])))
    np.testing.assert_array_equal(cleaned.run.q[:, 1], q)
    assert not cleaned.faulty.any()


def test_spikes_are_bridged_and_marked():
    rng = np.random.default_rng(8)
    true = draw_smooth(rng)
    q, tau = true.copy(), np.sin(5 * T)
    q[1000] += 0.3
    q[2000:2002] = 0.0
    tau[1500] = 40.0
    cleaned = clean(make_run(q, tau.copy()))
    assert np.abs(cleaned.run.q[:, 0] - true).max() < 1e-4
    assert np.flatnonzero(cleaned.faulty[:, 0]).tolist() == [1000, 1500, 2000, 2001]
    assert cleaned.run.tau[1500, 0] == pytest.approx(np.sin(5 * T[1500]), abs=1e-4)
    assert len(cleaned.notes) == 2


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
def test_full_turns_are_taken_out_at_any_step_of_the_clock(turn):
    rng = np.random.default_rng(10)
    t = np.sort(rng.choice(T, len(T) // 2, replace=False))
    true = turn * (0.3 + 1.4 * np.sin(t)) + 1e-4 * turn * rng.normal(size=len(t))
    for around in (0.0, 0.5):
        found, jumps = unwrap_turns((true + around * turn) % turn - around * turn, turn)
        np.testing.assert_allclose(np.diff(found), np.diff(true), atol=1e-9 * turn)
        assert jumps > 4
    assert unwrap_turns(true, turn)[0] is true
    # A spike, a lost count and a quick move are none.
    for other in (0.3 * turn, 0.7 * turn):
        odd = true.copy()
        odd[500] += other
        odd[900:] += other
        np.testing.assert_array_equal(unwrap_turns(odd, turn)[0], odd)


def test_start_up_is_cut_and_a_step_in_the_middle_refused():
    q = 1.0 + np.sin(T)
    q[:100] = 0.0
    q[:100] += 1e-5 * np.random.default_rng(9).normal(size=100)
    cleaned = clean(make_run(q))
    assert cleaned.run.t[0] == T[100] and len(cleaned.run.q) == len(cleaned.faulty) == len(T) - 100
    assert "rows before it are cut off" in cleaned.notes[0]
    q = np.sin(T)
    q[1400:] += 0.4
    with pytest.raises(InputError, match=r"'q_j0' steps by 0\.4 at t = 5\.6 s.*split the run"):
        clean(make_run(q))


def move_quickly(t, start, end, size):
    """A move of least jerk (Flash and Hogan 1985) between two rests."""
    u = np.clip((t - start) / (end - start), 0.0, 1.0)
    return size * (10 * u**3 - 15 * u**4 + 6 * u**5)


@pytest.mark.parametrize("took", [0.2, 0.22, 0.26, 0.3, 0.4])
def test_a_quick_move_in_a_slow_record_is_no_step(took):
    """Moves of a few samples at 50 Hz, between rests and slower ones; a step there is one all the same."""
    t = np.arange(1500) / 50.0
    rng = np.random.default_rng(3)
    q = sum(move_quickly(t, k + 0.2, k + 0.9, s) for k, s in enumerate(rng.uniform(-0.1, 0.1, 28)))
    q = q + move_quickly(t, 14.95, 14.95 + took, 0.1)
    cleaned = clean(make_run(q, t=t))
    assert len(cleaned.run.q) == len(t) and not cleaned.faulty.any()
    with pytest.raises(InputError, match=r"steps by 0\.1"):
        clean(make_run(q + 0.1 * (t > 14.5), t=t))


@pytest.mark.parametrize("size", [0.07, 0.08, 0.1])
def test_a_joint_that_is_pushed_comes_back(size):
    """A light joint that a knock moves in one sample and its controller brings back; a step stays."""
    t = np.arange(1500) / 50.0
    q = np.sin(t**2 / 60.0) + 1e-3 * np.random.default_rng(5).normal(size=len(t))
    pushed = q.copy()
    pushed[375:379] -= size * np.array([1.0, 0.67, 0.34, 0.02])
    cleaned = clean(make_run(pushed, t=t))
    assert len(cleaned.run.q) == len(t) and not cleaned.faulty.any()
    with pytest.raises(InputError, match=r"steps by -0\.\d+ at t = 7\.5 s"):
        clean(make_run(q - size * (t > 7.49), t=t))


def test_a_recorded_speed_tells_a_move_from_a_step():
    """One sample from rest to rest: only the speed says that the joint went there."""
    q = np.where(T < 5.6, 0.0, 0.4) + np.sin(T)
    at = int(np.argmax(T >= 5.6))
    told = np.cos(T)
    told[at - 1 : at + 1] += 0.4 * RATE
    assert not clean(make_run(q, qd=told[:, None])).faulty.any()
    with pytest.raises(InputError, match=r"steps by 0\.4"):
        clean(make_run(q, qd=np.cos(T)[:, None]))


def test_lost_motion_goes_back_and_forth_and_stays():
    """The gap of a gear, crossed in four samples at each reversal of the load; an encoder slips in one."""
    away = np.zeros(len(T))
    for k in range(600, 2400, 600):
        away[k:] = (0.0, 0.12)[k // 600 % 2]
    crossed = np.convolve(away, np.ones(4) / 4)[: len(T)]
    cleaned = clean(make_run(np.sin(T) + crossed))
    assert len(cleaned.run.q) == len(T)
    assert not cleaned.faulty.any()
    with pytest.raises(InputError, match=r"steps by 0\.12 at t = 2\.4 s"):
        clean(make_run(np.sin(T) + away))
    once = np.convolve(np.where(T < 2.4, 0.0, 0.12), np.ones(4) / 4)[: len(T)]
    with pytest.raises(InputError, match=r"steps by 0\.12"):
        clean(make_run(np.sin(T) + once))


def test_frozen_torque_counts_only_where_the_joint_rests():
    q, tau = np.sin(T), np.cos(5 * T)
    tau[1000:1300] = tau[1000]
    faulty = clean(make_run(q, tau)).faulty[:, 0]
    assert faulty[1000:1300].all() and faulty.sum() == 300
    q[900:1400] = q[900]
    q[1400:] = q[900] + np.sin(T[1400:] - T[1400])
    assert not clean(make_run(q, tau)).faulty.any()


def test_clipped_torque_is_found_with_and_without_noise():
    need = 10 * np.sin(2 * T)[:, None]
    for noise in (0.0, 0.05):
        tau = np.clip(need, -7.0, 7.0) + noise * np.random.default_rng(10).normal(size=need.shape)
        found = find_clipped(tau, need, np.cos(T)[:, None], [np.inf])[:, 0]
        beyond = np.abs(need[:, 0]) > 7.3
        assert found[beyond].all()
        assert not found[np.abs(need[:, 0]) < 6.5].any()


@pytest.mark.parametrize(("limit", "is_at_it"), [(7.0, True), (4.0, False)])
def test_a_torque_that_goes_beyond_a_stated_limit_is_not_held_by_it(limit, is_at_it):
    need = 10 * np.sin(2 * T)[:, None]
    tau = np.clip(need, -limit, limit) if is_at_it else need
    tau = tau + 0.02 * np.random.default_rng(12).normal(size=need.shape)
    assert goes_beyond(tau[:, 0], limit) != is_at_it


def test_peaks_that_merely_miss_the_prediction_are_not_clipped():
    rng = np.random.default_rng(11)
    need = draw_smooth(rng)[:, None]
    tau = 0.9 * need + 0.01 * rng.normal(size=need.shape)
    assert not find_clipped(tau, need, np.gradient(need, axis=0), [np.inf]).any()


def test_a_joint_whose_torque_is_nearly_all_friction_is_not_clipped():
    """A light wrist: two plateaus, of which the middle of the torque's range holds none, and rest."""
    rng = np.random.default_rng(14)
    v = draw_smooth(rng)[:, None]
    rests = T < 0.1 * T[-1]
    v[rests] = 1e-6 * rng.normal(size=(rests.sum(), 1))
    tau = np.where(rests[:, None], 0.0, 0.5 * np.sign(v) + 0.05 * v / v.std())
    tau += 0.02 * rng.normal(size=v.shape)
    none = np.zeros(tau.shape, dtype=bool)
    run = RoughRun("train", T, np.zeros(v.shape), np.gradient(v, T, axis=0), np.sign(v), v, tau, none, none)
    (predicted,) = predict_rough([run], inner=True)
    assert np.std((predicted - tau)[~rests]) < 0.2 * np.std(tau)
    assert not find_clipped(tau, predicted, v, [np.inf]).any()


def test_a_plateau_of_friction_is_no_limit_though_its_slow_reversals_spoil_the_prediction():
    rng = np.random.default_rng(15)
    v = np.cos(T + 2.0 * np.sin(0.37 * T))[:, None]
    wanted = 0.12 * np.tanh(v / 0.06)
    tau = wanted + 0.0005 * rng.normal(size=v.shape)
    predicted = wanted + 0.03 * np.sin(1.3 * T)[:, None] * np.sign(v)
    assert not find_clipped(tau, predicted, v, [np.inf]).any()
    load = 0.1 * np.sin(0.8 * T)[:, None]
    clipped = np.clip(wanted + load, -0.15, 0.15) + 0.0005 * rng.normal(size=v.shape)
    at = find_clipped(clipped, wanted + load, v, [np.inf])
    assert at[np.abs(wanted + load) > 0.16].mean() > 0.95 and not at[np.abs(wanted + load) < 0.14].any()


def test_a_torque_that_stays_while_its_joint_rests_is_at_no_limit():
    """Others move, and what their motion is said to ask of it is not what its friction or brake holds."""
    rng = np.random.default_rng(16)
    v = np.where(T > 0.9 * T[-1], np.sin(8.0 * T), 1e-6 * rng.normal(size=len(T)))[:, None]
    tau = np.where(v < -1e-3, -0.6, 0.0) + 0.003 * rng.normal(size=v.shape)
    load = 0.3 * np.sin(2.0 * T)[:, None] * (np.abs(v) < 1e-3)
    assert not find_clipped(tau, tau + load, v, [np.inf]).any()
    # The same where it moves all the time.
    moving = np.cos(5.0 * T)[:, None]
    assert find_clipped(tau, tau + load, moving, [np.inf]).any()


def test_stated_torque_limits_are_believed():
    tau = 10 * np.sin(2 * T)[:, None]
    assert find_clipped(tau, tau, np.gradient(tau, axis=0), [9.0])[:, 0].sum() == (np.abs(tau) >= 8.991).sum()


def test_bridge_follows_the_prediction_and_meets_the_neighbours():
    tau, predicted = np.sin(T)[:, None], np.sin(T)[:, None] - 0.3
    bad = np.zeros(tau.shape, dtype=bool)
    bad[500:900] = True
    spoilt = np.where(bad, 99.0, tau)
    np.testing.assert_allclose(bridge_torque(spoilt, predicted, bad), tau, atol=1e-12)
