"""Where the shapes of an effect are looked for: the grids, on motions whose answer is plain arithmetic."""

from pathlib import Path

import numpy as np
import pytest

from wearscope.effects.base import Signals, load_effect
from wearscope.effects.temperature_dependent_friction import LEAST_SPAN
from wearscope.effects.torque_ripple import FEWEST_PERIODS, LOWEST_ORDER
from wearscope.robots.model import load_model

ROBOTS = Path(__file__).parents[2] / "config" / "robots"


def sweep(top_speed=2.0, reach=1.5, seconds=10.0, samples=1001, span=0.0) -> Signals:
    """One joint over `reach` there and back, speeds spread evenly up to `top_speed`, temperature rising."""
    t = np.linspace(0.0, seconds, samples)
    q = reach * np.interp(t / seconds, [0.0, 0.5, 1.0], [0.0, 1.0, 0.0])[:, None]
    v = np.linspace(-top_speed, top_speed, samples)[:, None]
    temperature = 30.0 + span * (t / seconds)[:, None]
    load = 40.0 * np.where(np.arange(samples) % 2, 1.0, -1.0)[:, None]
    return Signals.along(t, v, q, load=load, temperature=temperature)


def test_stribeck_speeds_are_shares_of_the_top_speed():
    shapes = load_effect("stribeck").shapes(sweep(top_speed=2.0), 0)
    assert sorted(set(shapes[:, 0])) == pytest.approx([0.04, 0.1, 0.2, 0.4, 0.8])
    assert set(shapes[:, 1]) == {1.0, 2.0}
    assert len(shapes) == 10
    law = load_effect("friction_wear_temperature").shapes(sweep(top_speed=2.0), 0)
    assert law[:, 0] == pytest.approx([0.04, 0.1, 0.2, 0.4, 0.8])


def test_ripples_reach_from_few_periods_over_the_range_to_what_the_band_lets_through():
    # Speeds spread evenly to 2: the fifth of those above a hundredth of it is at 0.01 + 0.2 x 0.99 of it.
    signals = sweep(top_speed=2.0, reach=1.5)
    signals.bandwidth = 10.0
    waves = load_effect("torque_ripple").shapes(signals, 0)[:, 0]
    slow = 2.0 * (0.01 + 0.2 * 0.99)
    assert waves[0] == pytest.approx(2.0 * np.pi * FEWEST_PERIODS / 1.5)
    assert np.diff(waves) == pytest.approx(np.pi / 1.5)
    assert waves[-1] == pytest.approx(2.0 * np.pi * 10.0 / slow, abs=1.01 * np.pi / 1.5)
    # Sampled at 100 Hz, two samples and a half a period are asked for; over the range, 300 periods at most.
    signals.bandwidth = np.inf
    sampled = load_effect("torque_ripple").shapes(signals, 0)[-1, 0]
    assert sampled == pytest.approx(2.0 * np.pi * 0.4 / 0.01 / slow, abs=1.01 * np.pi / 1.5)
    dense = sweep(top_speed=2.0, reach=1.5, samples=100_001)
    last = load_effect("torque_ripple").shapes(dense, 0)[-1, 0]
    assert last == pytest.approx(2.0 * np.pi * 300.0 / 1.5, abs=1.01 * np.pi / 1.5)
    # Over two turns waves of one and a half periods would be the rigid body's own.
    assert load_effect("torque_ripple").shapes(sweep(reach=4.0 * np.pi), 0)[0, 0] == LOWEST_ORDER


def test_the_longest_ripple_has_next_to_nothing_in_common_with_a_spring():
    q = np.linspace(-1.0, 1.0, 2001)
    waves = np.column_stack(
        [np.ones_like(q), np.cos(np.pi * FEWEST_PERIODS * q), np.sin(np.pi * FEWEST_PERIODS * q)]
    )
    line = waves @ np.linalg.lstsq(waves, q, rcond=None)[0]
    assert np.linalg.norm(line) / np.linalg.norm(q) == pytest.approx(0.11, abs=0.005)


def test_a_rigid_body_turns_no_joint_with_waves_of_the_lowest_order_of_a_ripple():
    """Its torque over a joint's angle, in whatever pose, speed and acceleration."""
    body = load_model(ROBOTS / "large").rigid_body()
    rng = np.random.default_rng(4)
    angle = 2.0 * np.pi * np.arange(32) / 32
    for joint in range(body.n):
        q, v, a = (np.tile(rng.normal(size=body.n), (32, 1)) for _ in range(3))
        q[:, joint] = angle
        torque = body.inverse_dynamics(q, v, a)
        size = np.abs(np.fft.rfft(torque, axis=0))
        assert size[int(LOWEST_ORDER) :].max() < 1e-9 * size.max()


def test_the_other_grids_scale_with_what_they_are_about():
    signals = sweep(reach=1.5, seconds=10.0, span=4.0)
    dahl = load_effect("presliding_hysteresis").shapes(signals, 0)[:, 0]
    assert dahl[[0, -1]] == pytest.approx([1.5e-3, 0.45]) and len(dahl) == 7
    assert np.diff(np.log(dahl)) == pytest.approx(np.log(300.0) / 6)
    backlash = load_effect("backlash").shapes(signals, 0)[:, 0]
    assert backlash == pytest.approx([1.2, 4.0, 12.0], rel=1e-6)  # the load's standard deviation is 40
    assert load_effect("warm_up_drift").shapes(signals, 0)[:, 0] == pytest.approx([1.0, 3.0, 10.0, 30.0])
    warm = load_effect("temperature_dependent_friction").shapes(signals, 0)
    assert warm[:, 0] == pytest.approx(32.0) and warm[0, 1] < 0.01 < 0.06 < warm[-1, 1]


@pytest.mark.parametrize(
    ("span", "seen"), [(0.0, False), (0.9 * LEAST_SPAN, False), (1.1 * LEAST_SPAN, True)]
)
def test_a_temperature_that_hardly_changes_tells_nothing(span, seen):
    assert load_effect("temperature_dependent_friction").is_usable(sweep(span=span), 0) is seen
