"""Clocks of real recorders: any origin, uneven steps, lost samples, gaps."""

from dataclasses import replace

import numpy as np
import pytest
from folders import change_runs, check

from wearscope.closed_loop.intake.clock import (
    check_clock,
    mark_losses,
    resample,
    space_evenly,
    split_at_gaps,
)
from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.thinning import Budget, thin_dataset
from wearscope.errors import InputError

RATE = 100.0
T = np.arange(2000) / RATE


def make_run(t):
    x = np.sin(2 * np.pi * 0.5 * t)[:, None]
    return Run("r.parquet", "train", t - t[0], x, 3 * x, None, None, None, start=float(t[0]))


#: The log of a published arm's controller: 10, 10, 12 ms.
STEPS = np.cumsum(np.resize([0.010, 0.010, 0.012], 2000))


@pytest.mark.parametrize("rate", [100.0, 93.75, 93.6])
def test_a_clock_of_two_steps_has_either_rate(rate):
    check_clock("f", STEPS, rate)
    uniform = resample(make_run(STEPS), rate)
    np.testing.assert_allclose(np.diff(uniform.t), 1 / rate)
    assert np.abs(uniform.q[:, 0] - np.sin(2 * np.pi * 0.5 * (uniform.t + STEPS[0]))).max() < 5e-4


@pytest.mark.parametrize("rate", [97.0, 90.0])
def test_a_clock_that_is_a_bit_off_is_noted(rate):
    (note,) = check_clock("f", STEPS, rate)
    assert f"recorded at 93.75 Hz and brought to {rate:g} Hz" in note


@pytest.mark.parametrize("rate", [60.0, 50.0])
def test_a_clock_of_another_rate_is_refused(rate):
    told = r"which is 100 Hz \(93\.75\d* Hz on average\), where sample_rate says"
    with pytest.raises(InputError, match=told):
        check_clock("f", STEPS, rate)


@pytest.mark.parametrize("stamps_jitter", [True, False])
def test_jitter_is_told_from_uneven_sampling_by_the_smoothness_of_positions(stamps_jitter):
    kept = np.delete(np.arange(2000), [700, 701])
    late = T[kept] + np.random.default_rng(3).uniform(-2e-3, 2e-3, len(kept))
    run = make_run(T[kept] if stamps_jitter else late)
    run, _ = split_at_gaps(replace(run, t=late), RATE, "f")
    even, notes = space_evenly(run[0], RATE)
    uniform = resample(even, RATE)
    error = uniform.q[:, 0] - np.sin(np.pi * (uniform.t - uniform.t[0] + (0.0 if stamps_jitter else late[0])))
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert ("jitters by up to 2" in "".join(notes)) == stamps_jitter
    assert {700, 701} <= set(np.flatnonzero(mark_losses(uniform))) <= {699, 700, 701, 702}


def test_a_few_lost_samples_are_interpolated_and_marked():
    kept = np.ones(2000, dtype=bool)
    kept[[500, 900, 901, 902]] = False
    (run,), notes = split_at_gaps(make_run(T[kept]), RATE, "f")
    assert "4 samples lost at 2 places" in notes[0]
    uniform = resample(run, RATE)
    assert np.flatnonzero(mark_losses(uniform)).tolist() == [500, 900, 901, 902]
    assert np.abs(uniform.q[:, 0] - np.sin(np.pi * T)).max() < 3e-3


def test_a_gap_splits_a_run_and_short_pieces_are_left_out():
    t = T + np.where(np.arange(2000) >= 800, 2.0, 0.0) + np.where(np.arange(2000) >= 830, 3.0, 0.0)
    pieces, notes = split_at_gaps(make_run(t + 1.7e9), RATE, "f")
    assert [len(piece.t) for piece in pieces] == [800, 1170]
    assert [piece.piece for piece in pieces] == [1, 2]
    assert [piece.label for piece in pieces] == ["r.parquet#1", "r.parquet#2"]
    assert pieces[1].t[0] == pytest.approx(13.3, abs=1e-5) and pieces[1].start == 1.7e9
    assert any("30 rows from t = 1700000010 s on" in note for note in notes)
    assert any("'t' jumps at 2 place(s), first by 2.01 s at row 800" in note for note in notes)


def test_time_since_the_epoch_is_as_good_as_time_since_start(record):
    folder = record(runs=3)
    one = check(folder)
    change_runs(folder, lambda table: table.assign(t=table["t"] + 1.7e9))
    other = check(folder)
    for a, b in zip(one.runs, other.runs, strict=True):
        assert b.start == 1.7e9 and b.t[0] < 2.0
        np.testing.assert_allclose(b.t, a.t, atol=1e-6)
        np.testing.assert_allclose(b.measured, a.measured, atol=1e-3 * a.measured.std())
        np.testing.assert_allclose(b.signals.t, a.signals.t, atol=1e-6)


def test_pieces_are_runs_of_one_file_with_the_same_rows(record):
    """What lies away from the gap is what the whole run gives."""
    folder = record(runs=3)
    whole = check(folder)
    change_runs(folder, lambda table: table.drop(index=range(1000, 1060)))
    split = check(folder)
    assert [run.label for run in split.runs[:2]] == ["runs/r0.parquet#1", "runs/r0.parquet#2"]
    assert len({run.label for run in split.runs}) == len(split.runs) == 6
    assert len(split.runs_for("test")) == 2 and split.runs[1].file == split.runs[0].file
    end = split.runs[0].signals.t[0]
    assert end == pytest.approx(1.0 / split.band.motion, abs=1 / 200)
    assert split.runs[1].signals.t[0] == pytest.approx(1060 / 200 + end)
    one, piece = whole.runs[0].signals, split.runs[1].signals
    inner = slice(200, len(piece.t) - 200)
    at = np.searchsorted(one.t, piece.t[inner] - 1e-6)
    np.testing.assert_allclose(piece.q[inner], one.q[at], atol=1e-4)
    np.testing.assert_allclose(piece.load[inner], one.load[at], atol=0.02 * one.load.std())


@pytest.mark.parametrize("jump", [7.2e4, 1.7e9, 1e12])
def test_a_gap_is_not_recorded_however_long(record, jump):
    """A pause, a clock that finds the network's time, and stamps that are none."""
    folder = record(runs=3)
    whole = check(folder)
    change_runs(folder, lambda table: table.assign(t=table["t"] + np.where(table.index >= 1200, jump, 0.0)))
    split = check(folder)
    assert not [note for note in split.notes if "more is recorded than" in note]
    assert len(split.runs) == 2 * len(whole.runs)
    for record_ in split.dataset.runs:
        assert record_.seconds == pytest.approx(12.0, abs=0.02)
    assert split.runs[1].start + split.runs[1].t[-1] == pytest.approx(jump + 12.0, abs=1.0)
    waited = jump if jump < 1e6 else 0.0
    assert split.runs[1].t[0] - split.runs[0].t[-1] == pytest.approx(waited, abs=1.0)
    (note,) = [note for note in split.notes if "r0.parquet: column 't' jumps" in note]
    assert "2 piece(s) of 12 s" in note and ("clock that was set" in note) == (not waited)
    thinned = thin_dataset(split.dataset, Budget(joint_seconds=20.0, tested=1.0, stretch=2.0))
    for run in thinned.runs:
        inside = [(a, b) for a, b in run.stretches for c, d in run.recorded if c <= a < b <= d]
        assert len(inside) == len(run.stretches) <= 12


def test_lost_samples_do_not_count(record):
    folder = record(runs=3)
    whole = check(folder)
    rng = np.random.default_rng(0)
    change_runs(
        folder, lambda table: table.drop(index=np.sort(rng.choice(np.arange(50, 2300), 40, replace=False)))
    )
    thinned = check(folder)
    assert any("samples lost" in note for note in thinned.notes)
    for a, b in zip(whole.runs, thinned.runs, strict=True):
        assert b.keep.mean() > a.keep.mean() - 0.1
        both = (a.keep & b.keep).all(axis=1)
        assert np.abs(a.measured - b.measured)[both].std() < 0.02 * a.measured.std()
