"""Detectors of the torque signature and of the torque distribution: known answers and invariances."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import gaussian_kde, norm

from wearscope.detectors.base import Batch, load_detector, name_unit
from wearscope.errors import InputError

THREE = ["residual_energy", "distribution_distance", "wasserstein"]


def make_batch(torque, rate=250.0):
    """One recording of two joints; the second one's torque is given."""
    n = len(torque)
    t = np.arange(n) / rate
    q = np.column_stack([np.sin(t), np.cos(t)])
    qd = np.column_stack([np.cos(t), -np.sin(t)])
    return Batch(t, q, qd, np.column_stack([np.full(n, 7.0), torque]))


def make_nominal(seed=0, n=4000):
    noise = np.random.default_rng(seed).normal(size=n)
    t = np.arange(n) / 250.0
    return make_batch(50 * np.sin(2 * t) + 20 * np.sign(np.cos(2 * t)) + noise)


def fitted(name, batch, **options):
    detector = load_detector(name, options)
    detector.fit([batch], 1, None)
    return detector


@pytest.mark.parametrize("name", THREE)
@pytest.mark.parametrize("other", [0.0, 100.0])
def test_nominal_batch_gives_zero_whatever_the_other_axis_does(name, other):
    nominal = make_nominal()
    detector = fitted(name, nominal)
    nominal.tau[:, 0] += other
    assert detector.test_quantity(nominal) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", THREE)
def test_rises_with_planted_friction(name):
    nominal = make_nominal()
    detector = fitted(name, nominal)
    direction = np.sign(np.cos(2 * nominal.t))
    torques = [make_nominal(k).tau[:, 1] + k * 4 * direction for k in range(6)]
    y = [detector.test_quantity(make_batch(torque)) for torque in torques]
    assert np.all(np.diff(y) > 0)


@pytest.mark.parametrize("name", ["distribution_distance", "wasserstein"])
def test_distribution_ignores_the_order_of_samples(name):
    nominal, worn = make_nominal(), make_nominal(1)
    torque = worn.tau[:, 1] * 1.2
    detector = fitted(name, nominal)
    shuffled = np.random.default_rng(2).permutation(torque)
    assert detector.test_quantity(make_batch(torque)) == pytest.approx(
        detector.test_quantity(make_batch(shuffled)), rel=1e-12
    )


def test_residual_energy_known_answer():
    nominal = make_nominal()
    detector = fitted("residual_energy", nominal)
    assert detector.test_quantity(make_batch(1.3 * nominal.tau[:, 1])) == pytest.approx(0.09, rel=1e-12)
    longer = np.concatenate([nominal.tau[:, 1], np.full(50, 1e6)])
    assert detector.test_quantity(make_batch(longer)) == 0


def test_residual_energy_refuses_short_batches():
    nominal = make_nominal()
    detector = fitted("residual_energy", nominal)
    with pytest.raises(ValueError, match="covers 1000 of the signature's 4000"):
        detector.test_quantity(make_batch(nominal.tau[:1000, 1]))
    with pytest.raises(ValueError, match="covers 1000 of the signature's 4000"):
        detector.test_quantity(make_batch(nominal.tau[:500, 1], rate=125.0))


def test_residual_energy_pairs_batches_of_another_rate_by_time():
    """A smooth torque 1.3 times the nominal one: 0.09 at any rate; what comes after does not count."""
    t = np.arange(4000) / 250.0
    detector = fitted("residual_energy", make_batch(5.0 + np.sin(t)))
    for rate in (125.0, 90.0, 400.0):
        fewer = np.arange(int(15.9 * rate)) / rate
        for scale in (1.0, 1.3):
            y = detector.test_quantity(make_batch(scale * (5.0 + np.sin(fewer)), rate=rate))
            assert y == pytest.approx((scale - 1.0) ** 2, rel=1e-3, abs=1e-9)
    for rate in (125.0, 500.0, 100.0):
        longer = np.arange(int(20.0 * rate)) / rate
        torque = np.where(longer <= t[-1], 5.0 + np.sin(longer), 1e6)
        assert detector.test_quantity(make_batch(torque, rate=rate)) < 1e-9


def make_moves(dwell, moves=6, samples=200):
    """Moves of one joint with rests of `dwell` samples between them."""
    phase = 2 * np.pi * (np.arange(samples) + 0.5) / samples
    speed = np.concatenate([np.concatenate([np.zeros(dwell), 1 - np.cos(phase)]) for _ in range(moves)])
    speed = np.concatenate([speed, np.zeros(30)])
    q = np.column_stack([np.zeros_like(speed), np.cumsum(speed) / 250])
    qd = np.column_stack([np.zeros_like(speed), speed])
    return Batch(
        np.arange(len(speed)) / 250, q, qd, np.column_stack([np.zeros_like(speed), 5 * speed**2 + 1])
    )


def test_residual_energy_aligned_by_path_ignores_delays_at_rest():
    nominal, late = make_moves(12), make_moves(18)
    assert fitted("residual_energy", nominal).test_quantity(late) > 0.1
    detector = fitted("residual_energy", nominal, align="path")
    assert detector.test_quantity(late) == pytest.approx(0, abs=1e-15)
    late.tau[:, 1] *= 1.1
    assert detector.test_quantity(late) == pytest.approx(0.01, rel=1e-9)
    late.qd[:] = 0
    with pytest.raises(ValueError, match="no joint moves"):
        detector.test_quantity(late)


def test_residual_energy_averages_nominal_batches():
    a, b = make_nominal(1), make_nominal(2, n=3990)
    detector = load_detector("residual_energy", {})
    detector.fit([a, b], 1, None)
    mean = 0.5 * (a.tau[:3990, 1] + b.tau[:, 1])
    assert detector.test_quantity(make_batch(mean)) == pytest.approx(0, abs=1e-15)


def test_binned_density_agrees_with_the_exact_kernel_estimate():
    nominal = make_nominal()
    torque = nominal.tau[:, 1]
    detector = fitted("distribution_distance", nominal, bandwidth=3.0)
    step = detector.grid[1] - detector.grid[0]
    exact = gaussian_kde(torque, bw_method=3.0 / torque.std(ddof=1))(detector.grid) * step
    floored = (1 - detector.floor) * exact + detector.floor / detector.grid_size
    assert detector.estimate_mass(torque) == pytest.approx(floored, abs=2e-3 * floored.max())
    assert detector.estimate_mass(torque).sum() == pytest.approx(1, rel=1e-12)


def test_distance_of_two_gaussians_is_the_known_divergence():
    # Quantiles represent samples; kernel smoothing widens both to variance s^2 + h^2.
    sample = norm.ppf((np.arange(20000) + 0.5) / 20000) * 10
    shift, width = 6.0, 2.0
    detector = fitted(
        "distribution_distance", make_batch(sample), bandwidth=width, floor=1e-9, grid_size=1024, margin=0.5
    )
    expected = shift**2 / (100 + width**2)
    assert detector.test_quantity(make_batch(sample + shift)) == pytest.approx(expected, rel=0.01)


def test_distance_stays_finite_where_the_supports_are_apart():
    nominal = make_nominal()
    detector = fitted("distribution_distance", nominal)
    far = detector.test_quantity(make_batch(nominal.tau[:, 1] + 1e4))
    assert np.isfinite(far)
    assert far < np.log(detector.grid_size / detector.floor) * 2


def test_bandwidth_is_silvermans_and_stays_with_the_nominal_data_as_the_grid_does():
    torque = make_nominal().tau[:, 1]
    detector = fitted("distribution_distance", make_batch(torque))
    width, grid = detector.width, detector.grid.copy()
    detector.test_quantity(make_batch(torque * 5))
    assert detector.width == width
    assert np.array_equal(detector.grid, grid)
    spread = min(torque.std(ddof=1), np.subtract(*np.percentile(torque, [75, 25])) / 1.34)
    assert width == pytest.approx(0.9 * spread * 4000**-0.2, rel=1e-12)
    # Without a spread of the middle half it is that of all: quartiles 0 and 0, variance 32 / 9.
    spikes = fitted("distribution_distance", make_batch(np.array([0.0] * 8 + [-4.0, 4.0])))
    assert spikes.width == pytest.approx(0.9 * np.sqrt(32.0 / 9.0) * 10**-0.2, rel=1e-12)


def test_wasserstein_of_a_shift_is_the_shift():
    nominal = make_nominal()
    assert fitted("wasserstein", nominal).test_quantity(make_batch(nominal.tau[:, 1] - 2.5)) == pytest.approx(
        2.5
    )


@pytest.mark.parametrize("name", ["distribution_distance", "wasserstein"])
def test_torque_that_is_not_finite_is_refused(name):
    nominal = make_nominal()
    torque = nominal.tau[:, 1].copy()
    torque[5] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        fitted(name, nominal).test_quantity(make_batch(torque))


@pytest.mark.parametrize("name", THREE)
def test_nominal_data_that_teach_nothing_are_refused(name):
    with pytest.raises(ValueError, match="no nominal batch"):
        load_detector(name).fit([], 1, None)
    broken = make_nominal()
    broken.tau[3, 1] = np.inf
    with pytest.raises(ValueError, match="not finite"):
        load_detector(name).fit([broken], 1, None)


def test_batch_refuses_shapes_that_do_not_fit():
    t = np.arange(5) / 10
    with pytest.raises(ValueError, match="tau has shape"):
        Batch(t, np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 3)))
    for time in (t[:1], np.zeros((5, 1)), np.zeros((1, 5))):
        with pytest.raises(ValueError, match=r"at least 2 samples of t"):
            Batch(time, *3 * [np.zeros((len(time), 2))])
    for shape in ((5,), (4, 2), (6, 2), (5, 2, 1)):
        with pytest.raises(ValueError, match="q has shape"):
            Batch(t, *3 * [np.zeros(shape)])
    assert Batch(t, np.zeros((5, 2)), np.zeros((5, 2)), np.zeros((5, 2))).sample_rate == pytest.approx(10)
    assert Batch(t[:2], *3 * [np.zeros((2, 2))]).sample_rate == pytest.approx(10)
    assert Batch(t, *3 * [np.zeros((5, 2))], sample_rate=7.0).sample_rate == 7.0


def test_the_path_of_a_steady_motion_is_at_the_middle_of_each_sample():
    """Five equal steps cover a fifth of the path each, and a sample represents the middle of its step."""
    t = np.arange(5) / 250.0
    qd = np.column_stack([np.zeros(5), np.full(5, 0.8)])
    batch = Batch(t, np.cumsum(qd, axis=0) / 250.0, qd, np.column_stack([np.zeros(5), np.arange(1.0, 6.0)]))
    detector = fitted("residual_energy", batch, align="path")
    np.testing.assert_allclose(detector.path, [0.1, 0.3, 0.5, 0.7, 0.9], rtol=1e-12)
    np.testing.assert_array_equal(detector.signature, np.arange(1.0, 6.0))


@pytest.mark.parametrize("n", [401, 402])
def test_a_batch_at_half_the_rate_is_read_up_to_the_signature_s_end(n):
    nominal = make_batch(np.linspace(-30.0, 50.0, n))
    torque = nominal.tau[::2, 1].copy()
    last = 200  # sample 400 of the signature
    torque[last] += 10.0
    late = make_batch(torque, rate=125.0)
    expected = 100.0 / np.sum(nominal.tau[::2, 1][: last + 1] ** 2)
    assert fitted("residual_energy", nominal).test_quantity(late) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "option", "taken", "refused"),
    [
        ("distribution_distance", "bandwidth", (1e-3,), (0.0, -1.0, np.nan)),
        ("distribution_distance", "grid_size", (16,), (15,)),
        ("distribution_distance", "margin", (0.0,), (-1e-9, np.nan)),
        ("distribution_distance", "floor", (1e-9, 0.999), (0.0, 1.0, np.nan)),
        ("residual_energy", "min_overlap", (1e-9, 1.0), (0.0, 1.001, np.nan)),
        ("residual_energy", "rest_share", (1e-9, 0.999), (0.0, 1.0, np.nan)),
        ("residual_energy", "align", ("start", "path"), ("end",)),
        ("friction_fit", "weights", ((1.0, 0.0, 2.0),), ((1.0, 2.0), (1.0, 2.0, 3.0, 4.0))),
        ("friction_fit", "low_speed_share", (1e-9,), (0.0, np.nan)),
        ("friction_change", "row", (1e-9,), (0.0, -1.0)),
        ("wear_temperature_fit", "max_iterations", (1,), (0,)),
        ("wear_temperature_fit", "temperature_limit", (50.001,), (50.0, np.nan)),
    ],
)
def test_options_reach_to_their_bounds_and_no_further(name, option, taken, refused):
    more = {"start_temperature": 50.0} if option == "temperature_limit" else {}
    for value in taken:
        assert getattr(load_detector(name, {option: value} | more), option) == value
    for value in refused:
        with pytest.raises(InputError, match=option):
            load_detector(name, {option: value} | more)


def test_a_test_quantity_s_unit_is_its_own_or_that_of_the_torque_of_what_wears():
    """Joints named first and second, of which one turns and one slides."""
    turning = SimpleNamespace(joints=["a", "b"], torque_units=["N m", "N"], wear_joints=["a"])
    sliding = SimpleNamespace(joints=["a", "b"], torque_units=["N m", "N"], wear_joints=["b"])
    for models, unit in (([turning], "N m"), ([sliding], "N"), ([sliding, turning], "N m or N")):
        assert name_unit(load_detector("friction_fit"), models) == unit
    assert name_unit(load_detector("distribution_distance"), [turning]) == "nat"
    assert name_unit(object(), [turning]) == ""
