"""What a model predicts along every run, and its errors there, with intervals and the noise floor."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.joint_flexibility import (
    add_terms,
    estimate_by_instruments,
    find_jump_shares,
    measure_gears,
    solve_gears,
)
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import MeasurementEffect, Signals

#: Iterations of the fit where a term acts on the prediction of the others.
_PASSES = 4
#: Number of resamplings for an interval.
_DRAWS = 400
#: Two runs repeat each other where their positions differ by less than this share of the reach (RMS). Samples
#: this time apart [s] are compared first.
_SAME, _LOOK = 0.01, 0.5


@dataclass
class Predicted:
    """Torque (M, n) that each stage predicts along one run, at the common bandwidth."""

    run: PreparedRun
    declared: np.ndarray
    before: np.ndarray
    after: np.ndarray


def predict_motor(
    model: Regression,
    theta: np.ndarray,
    run: PreparedRun,
    signals: Signals,
    shares: dict[int, float] | None = None,
) -> np.ndarray:
    """Full-rate torque (N, n) of the motors, before errors of the measurement.

    `shares` holds, by the index of a term, the share of its torque that is taken.
    """
    torque = run.known.copy()
    if model.inertial:
        s = signals
        torque += s.rigid_body.add_to_links(theta[: 10 * model.prepared.n], s.q, s.v, s.a)
    for i, (term, span) in enumerate(zip(model.entries, model.spans, strict=True)):
        if not term.is_measurement_error:
            torque += (shares or {}).get(i, 1.0) * (term.columns(signals) @ theta[span])
    return torque


def predict_full(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Full-rate torque (N, n) that a model predicts to be recorded along a run, from its motion alone."""
    signals = replace(run.signals, transmitted=solve_gears(model, theta, run))
    motor = predict_motor(model, theta, run, signals, find_jump_shares(model, theta))
    return _record(model, theta, signals, motor)


def predict_reduced(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """`predict_full` after the common filter, (M, n)."""
    return run.reduce_torque(predict_full(model, theta, run))


def _record(model: Regression, theta: np.ndarray, signals: Signals, motor: np.ndarray) -> np.ndarray:
    """Torque (N, n) that the sensors record where the motors' torque is `motor`."""
    late = replace(signals, torque=motor, lag=find_lags(model, theta))
    return add_terms(motor.copy(), model, theta, late, lambda term: term.is_measurement_error)


def find_lags(model: Regression, theta: np.ndarray) -> np.ndarray:
    """Delay [s] of each torque channel (n,) in a model."""
    lags = np.zeros(model.prepared.n)
    for term, span in zip(model.entries, model.spans, strict=True):
        if isinstance(term.effect, MeasurementEffect) and term.effect.kind == "lag":
            lags[term.joint] = theta[span][0]
    return lags


def find_operating_point(model: Regression) -> list[Signals]:
    """Signals of the training runs with the motors' and the gears' torque by a fitted model.

    Errors of the measurement act on the motors' torque, deflections of the gears on the gears' torque.
    """
    theta = model.solve()
    made = []
    for run in model.prepared.runs_for("train"):
        signals = find_signals(model, theta, run)
        assert signals.torque is not None
        recorded = _record(model, theta, signals, signals.torque)
        gears = measure_gears(model, theta, run, signals.transmitted, recorded)
        made.append(replace(signals, transmitted=gears))
    return made


def find_signals(model: Regression, theta: np.ndarray, run: PreparedRun) -> Signals:
    """Signals of a run, with a model's torque of motors and gears along the motion."""
    signals = replace(run.signals, transmitted=solve_gears(model, theta, run))
    motor = predict_motor(model, theta, run, signals)
    return replace(signals, torque=motor, lag=find_lags(model, theta))


def refit(
    base: Regression, entries: list[ModelTerm], known: Mapping[int, np.ndarray] | None = None
) -> Regression:
    """Regression like `base` with other terms.

    Errors of the measurement act on the motors' torque, and gears bend under their torque. Both torques
    depend on the other parameters, so the fit is repeated a few times. Coefficients that are `known`, by the
    index of their term, are not fitted.
    """
    known = dict(known or {})

    def fit(signals: list[Signals] | None, held: dict[int, np.ndarray]) -> Regression:
        return Regression(
            base.prepared, entries, base.sigma, base.inertial, base.blocks, held=held, signals=signals
        )

    model = fit(None, known)
    if any(term.is_measurement_error or term.is_deflection for term in entries):
        for _ in range(_PASSES):
            signals = find_operating_point(model)
            model = fit(signals, known)
            held = estimate_by_instruments(model) | known
            if held:
                model = fit(signals, held)
    return model


def predict_runs(prepared: Prepared, before: Regression, after: Regression) -> list[Predicted]:
    """Predictions along all runs."""
    theta = before.solve(), after.solve()
    return [
        Predicted(
            run,
            run.reduce(run.known),
            predict_reduced(before, theta[0], run),
            predict_reduced(after, theta[1], run),
        )
        for run in prepared.runs
    ]


def rms(residual: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Root mean square (n,) over the rows that count; NaN for joints without any."""
    count = keep.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(count > 0, np.sqrt((residual**2 * keep).sum(axis=0) / count), np.nan)


def relative_error(residual: np.ndarray, measured: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """100 |e| / |tau| over the rows that count, (n,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return 100.0 * rms(residual, keep) / rms(measured, keep)


def pooled_rms(parts: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """`rms` over several runs."""
    return rms(np.concatenate([r for r, _ in parts]), np.concatenate([k for _, k in parts]))


def bootstrap_rms(parts: list[tuple[np.ndarray, np.ndarray]], rows: int, seed: int) -> np.ndarray:
    """95 % interval (2, n) of the pooled rms, resampling blocks of `rows` rows."""
    return _interval(_draw_rms(parts, rows, seed))


def _interval(drawn: np.ndarray) -> np.ndarray:
    """95 % interval (2, n) of draws (draws, n), without draws in which no row of a joint counts."""
    found = np.full((2, drawn.shape[1]), np.nan)
    known = np.isfinite(drawn).any(axis=0)
    found[:, known] = np.nanquantile(drawn[:, known], [0.025, 0.975], axis=0)
    return found


def bootstrap_change(
    before: list[tuple[np.ndarray, np.ndarray]],
    after: list[tuple[np.ndarray, np.ndarray]],
    rows: int,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Change [%] (n,) of the pooled rms and its 95 % interval (2, n), with the same blocks drawn for both."""
    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = 100.0 * (_draw_rms(after, rows, seed) / _draw_rms(before, rows, seed) - 1.0)
        change = 100.0 * (pooled_rms(after) / pooled_rms(before) - 1.0)
    return change, _interval(drawn)


def _draw_rms(parts: list[tuple[np.ndarray, np.ndarray]], rows: int, seed: int) -> np.ndarray:
    """Pooled rms (`_DRAWS`, n) of blocks of `rows` rows drawn with replacement."""
    squares, counts = [], []
    for residual, keep in parts:
        for start in range(0, len(residual), rows):
            block = slice(start, start + rows)
            squares.append((residual[block] ** 2 * keep[block]).sum(axis=0))
            counts.append(keep[block].sum(axis=0))
    square, count = np.array(squares), np.array(counts)
    rng = np.random.default_rng(np.random.SeedSequence([seed, len(square)]))
    pick = rng.integers(0, len(square), (_DRAWS, len(square)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(square[pick].sum(axis=1) / count[pick].sum(axis=1)))


def find_repeats(prepared: Prepared) -> list[tuple[int, int]]:
    """Pairs of runs that follow the same trajectory under the same payload."""
    pairs = []
    runs, moving = prepared.runs, prepared.moving
    payload = {run.file: run.payload for run in prepared.dataset.runs}
    motions = [run.signals.q[:, moving] for run in runs]
    reaches = [np.maximum(np.ptp(q, axis=0), 1e-9) for q in motions]
    step = max(1, int(_LOOK * prepared.band.rate))
    looks = [np.ascontiguousarray(q[::step]) for q in motions]
    for i in range(len(runs)):
        for k in range(i + 1, len(runs)):
            a, b = motions[i], motions[k]
            short = min(len(a), len(b))
            if short < 0.9 * max(len(a), len(b)) or payload[runs[i].file] != payload[runs[k].file]:
                continue
            most = short * (_SAME * reaches[i]) ** 2
            # Most comparisons end early, at a few samples that are too far apart.
            few = min(len(looks[i]), len(looks[k]), -(-short // step))
            if np.any(((looks[i][:few] - looks[k][:few]) ** 2).sum(axis=0) > (1.0 + 1e-9) * most):
                continue
            apart = np.sqrt(np.mean((a[:short] - b[:short]) ** 2, axis=0)) / reaches[i]
            if np.all(apart < _SAME):
                pairs.append((i, k))
    return pairs


def noise_floor(prepared: Prepared, predicted: list[Predicted]) -> np.ndarray | None:
    """Rms (n,) of the torque that does not repeat when the motion does; None where no motion is repeated.

    The residual of the corrected model is used, so that a modelled difference between the repetitions (a
    temperature, say) does not count as noise.
    """
    parts = []
    for i, k in find_repeats(prepared):
        a, b = predicted[i], predicted[k]
        short = min(len(a.run.t), len(b.run.t))
        ea = (a.run.measured - a.after)[:short]
        eb = (b.run.measured - b.after)[:short]
        parts.append(((ea - eb) / np.sqrt(2.0), a.run.keep[:short] & b.run.keep[:short]))
    return pooled_rms(parts) if parts else None


def residual_table(prepared: Prepared, predicted: list[Predicted]) -> pd.DataFrame:
    """Long table of measured and predicted torque of every run."""
    frames = []
    for p in predicted:
        for j, joint in enumerate(prepared.dataset.joints):
            frames.append(
                pd.DataFrame(
                    {
                        "t": p.run.t,
                        "run": p.run.file,
                        "use": p.run.use,
                        "joint": joint,
                        "measured": p.run.measured[:, j],
                        "predicted_before": p.before[:, j],
                        "predicted_after": p.after[:, j],
                        "residual_before": p.run.measured[:, j] - p.before[:, j],
                        "residual_after": p.run.measured[:, j] - p.after[:, j],
                        "counts": p.run.keep[:, j],
                    }
                )
            )
    return pd.concat(frames, ignore_index=True)
