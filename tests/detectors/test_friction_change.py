"""Detector E against friction that is planted, and compared with C on the same recordings."""

from dataclasses import replace

import numpy as np
import pytest
from detectors.two_joints import MODEL, simulate

from wearscope.detectors.base import compute_joint_residual, compute_payload_torque, load_detector


def plain(v):
    return 20.0 * np.sign(v) + 8.0 * v


@pytest.fixture(scope="module")
def fitted():
    detector = load_detector("friction_change")
    detector.fit([simulate(plain, noise=0.3, seed=k) for k in range(2)], 0, MODEL)
    return detector


def test_nominal_batch_gives_next_to_nothing(fitted):
    values = [fitted.test_quantity(simulate(plain, noise=0.3, seed=k)) for k in range(10, 20)]
    assert np.abs(values).max() < 0.2


@pytest.mark.parametrize(("coulomb", "viscous"), [(2.0, 0.0), (0.0, 1.5), (-1.0, 0.5), (2.0, 1.0)])
def test_rise_of_friction_is_recovered(fitted, coulomb, viscous):
    batch = simulate(lambda v: plain(v) + coulomb * np.sign(v) + viscous * v, noise=0.3, seed=5)
    v = simulate(plain, seed=0).qd[:, 0]
    moving = np.abs(v) > 0.01 * np.quantile(np.abs(v), 0.99)
    expected = coulomb + viscous * np.abs(v[moving]).mean()
    assert fitted.test_quantity(batch) == pytest.approx(expected, abs=0.15)


def test_payload_error_is_not_taken_for_friction(fitted):
    heavier = fitted.test_quantity(simulate(plain, noise=0.3, seed=3, payload_factor=1.1))
    worn = fitted.test_quantity(simulate(lambda v: 1.1 * plain(v), noise=0.3, seed=3))
    assert abs(heavier) < 0.1 * worn


def test_wear_of_the_papers_law_raises_it(fitted):
    detector = load_detector("friction_change")
    detector.fit([simulate(noise=0.3, seed=0)], 0, MODEL)
    values = [detector.test_quantity(simulate(wear=f, noise=0.3, seed=4)) for f in (0.0, 10.0, 30.0, 50.0)]
    assert np.all(np.diff(values) > 0.2)


def test_axis_at_rest_is_refused(fitted):
    batch = simulate(plain)
    batch.qd[:, 0] = 0.0
    with pytest.raises(ValueError, match="moves for 0 s only"):
        fitted.test_quantity(batch)
    with pytest.raises(ValueError, match="does not move in the nominal data"):
        load_detector("friction_change").fit([batch], 0, MODEL)


def test_options_are_checked():
    with pytest.raises(Exception, match="payload_error should be greater than 0"):
        load_detector("friction_change", {"payload_error": 0.0})


def test_blocks_are_of_the_recording_s_time_and_start_at_the_first_row_in_motion_of_each(fitted):
    batch = simulate(plain, noise=0.3, seed=1)
    step = round(fitted.row * batch.sample_rate)
    length = round(fitted.block * batch.sample_rate / step)
    rows = len(batch.t) // step
    speed = np.full_like(batch.qd, fitted.top_speed)
    assert list(fitted.make_rows(replace(batch, qd=speed)).starts) == list(range(0, rows, length))
    # At rest for the first half of the first block, and from the middle of the recording on.
    still = speed.copy()
    still[: length // 2 * step] = 0.0
    still[rows // 2 * step :] = 0.0
    made = fitted.make_rows(replace(batch, qd=still))
    begun = [max(start - length // 2, 0) for start in range(0, rows // 2, length)]
    assert list(made.starts) == begun
    assert len(made.columns) == rows // 2 - length // 2


def test_the_nominal_friction_s_errors_are_those_of_its_blocks():
    """Least squares of the rows; their scatter by whole blocks, and how much more that is than by rows."""
    nominal = [simulate(plain, noise=0.3, seed=k) for k in range(2)]
    detector = load_detector("friction_change")
    detector.fit(nominal, 0, MODEL)
    noise = detector.noise
    detector.noise = 1.0
    made = [detector.make_rows(batch) for batch in nominal]
    x, y = np.vstack([one.base for one in made]), np.concatenate([one.target for one in made])
    mean = np.linalg.lstsq(x, y)[0]
    np.testing.assert_allclose(detector.mean, mean, rtol=1e-8)
    blocks, single = np.zeros((4, 4)), np.zeros(4)
    for one in made:
        left = one.target - one.base @ mean
        for start, end in zip(one.starts, [*one.starts[1:], len(left)], strict=True):
            total = one.base[start:end].T @ left[start:end]
            blocks += np.outer(total, total)
        single += left**2 @ one.base**2
    inverse = np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(detector.covariance, inverse @ blocks @ inverse, rtol=1e-6)
    memory = max(np.max(np.diag(blocks) / single), 1.0)
    assert noise == pytest.approx(np.sqrt(np.mean((y - x @ mean) ** 2) * memory))
    # Mean magnitudes of direction and speed along the motion.
    columns = np.vstack([one.columns for one in made])
    np.testing.assert_allclose(detector.mean_columns, np.abs(columns).mean(axis=0))


@pytest.mark.parametrize("share", [0.2, -0.05])
def test_rows_of_a_steady_motion_have_its_direction_bump_speed_and_load(fitted, share):
    """A bump that dies out over a tenth of the top speed is exp(-2) at a fifth, exp(-1/2) at a twentieth."""
    speed = share * fitted.top_speed
    batch = simulate(plain, noise=0.3, seed=1)
    batch = replace(batch, qd=np.full_like(batch.qd, speed), derived={})
    made = fitted.make_rows(batch)
    side = np.sign(share)
    base = [side, side * np.exp(-abs(share) / 0.1), speed, 1.0]
    np.testing.assert_allclose(fitted.noise * made.base, np.tile(base, (len(made.target), 1)), rtol=1e-9)
    np.testing.assert_allclose(fitted.noise * made.columns, np.tile([side, speed], (len(made.target), 1)))
    # Means over a row of what the payload's error, 10 % of it, and the residual are.
    step = round(fitted.row * batch.sample_rate)
    rows = len(batch.t) // step
    load = compute_payload_torque(batch, MODEL, fitted.window)[: rows * step, 0].reshape(rows, step)
    np.testing.assert_allclose(fitted.noise * made.load[:, 0], 0.1 * load.mean(axis=1), rtol=1e-9)
    left = compute_joint_residual(batch, MODEL, 0, fitted.window)[: rows * step].reshape(rows, step)
    np.testing.assert_allclose(fitted.noise * made.target, left.mean(axis=1), rtol=1e-9)
