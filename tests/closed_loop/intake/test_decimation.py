"""Fast recordings are thinned without a trace in the rows, and memory does not grow with the rate."""

import numpy as np
import pytest
from changed_fields import changed_fields
from folders import change_runs, read_prepared
from scipy import interpolate

from wearscope.closed_loop.intake import filtering
from wearscope.closed_loop.intake.filtering import choose_factor, decimate

RATE = 1000.0


@pytest.mark.parametrize("factor", [2, 3, 4, 7])
@pytest.mark.parametrize("length", [4000, 4001, 4003])
def test_decimation_has_no_phase_and_keeps_what_is_slow(factor, length):
    t = np.arange(length) / RATE
    highest = 0.24 * RATE / factor
    x = np.column_stack([np.cos(2 * np.pi * highest * t + 0.3), 2.0 + t, 0.5 * np.sin(3 * t)])
    thin = decimate(x, factor)
    assert thin.shape == x[::factor].shape
    inner = slice(25, -25)
    np.testing.assert_allclose(thin[inner], x[::factor][inner], atol=3e-4)
    np.testing.assert_allclose(thin[:, 1:], x[::factor, 1:], atol=3e-3)


def test_decimation_stops_what_would_fold_back():
    t = np.arange(8000) / RATE
    for frequency in (126.0, 180.0, 250.0, 374.0, 499.0):
        assert np.abs(decimate(np.cos(2 * np.pi * frequency * t), 4)[30:-30]).max() < 3e-3


def test_a_single_channel_and_no_thinning_at_all():
    x = np.random.default_rng(0).normal(size=500)
    assert decimate(x, 1) is x
    np.testing.assert_allclose(decimate(x, 3), decimate(x[:, None], 3)[:, 0])


@pytest.mark.parametrize(
    ("rate", "motion", "torque", "factor"),
    [
        *((rate, 5.0, 2.0, 1) for rate in (50.0, 100.0, 250.0, 499.0)),
        (1000.0, 30.0, 10.0, 4),
        (1000.0, 30.0, 24.0, 2),
        (1000.0, 118.0, 39.0, 1),
        (4000.0, 30.0, 10.0, 16),
    ],
)
def test_slow_recordings_stay_and_fast_ones_keep_what_the_filters_need(rate, motion, torque, factor):
    assert choose_factor(rate, motion, torque) == factor


def test_rows_are_those_of_the_full_rate(record, monkeypatch):
    """Rows of the thinned run against the same filters at the full rate, at the same times."""
    folder = record(runs=3, rate=RATE)
    thin = read_prepared(folder)
    assert thin.band.rate < 0.5 * RATE and any("are kept after the filters" in note for note in thin.notes)
    monkeypatch.setattr(filtering, "_LEAST_RATE", 1e9)
    full = read_prepared(folder)
    assert full.band.rate == RATE
    assert full.band.torque == pytest.approx(thin.band.torque, rel=0.1)
    for a, b in zip(full.runs, thin.runs, strict=True):
        assert a.signals.factor == 1
        assert b.signals.factor == pytest.approx(RATE / thin.band.rate)
        same = filtering.Band(RATE, a.band.motion, b.band.torque)
        for x, y in (
            (a.tau, b.tau), (a.known, b.known), (a.signals.q, b.signals.q), (a.signals.v, b.signals.v),
            (a.signals.a, b.signals.a), (a.signals.sign, b.signals.sign),
        ):  # fmt: skip
            low = filtering.low_pass(x, same.torque, RATE)
            at = interpolate.CubicSpline(a.signals.t, low)(b.t)
            assert np.abs(b.reduce(y) - at).std() < 1e-3 * at.std()


def test_memory_does_not_grow_with_the_rate(record):
    folder = record(runs=3, rate=RATE)
    prepared = read_prepared(folder)
    assert sum(len(run.tau) for run in prepared.runs) <= 3 * 12.0 * prepared.band.rate + 3
    assert prepared.band.rate <= 2 * max(250.0, 20 * prepared.band.torque)


@pytest.mark.parametrize("rate", [200.0, RATE])
def test_further_channels_come_with_the_torque(record, rate):
    """A motor current that is the torque over a constant has the torque's rows over that constant."""
    folder = record(runs=3, rate=rate)
    with changed_fields(folder / "dataset.yaml") as fields:
        fields["channels"] = {"current_a": "A"}
    change_runs(folder, lambda table: table.assign(current_a=table["tau_a"] / 4.0))
    for run in read_prepared(folder).runs:
        current = run.signals.channels["current_a"]
        assert current.shape == (len(run.tau),)
        np.testing.assert_allclose(run.reduce(current), run.measured[:, 0] / 4.0, rtol=1e-9, atol=1e-9)
