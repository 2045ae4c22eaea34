"""Errors of the models before and after on every run, with intervals and the noise floor."""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.intake.preprocessing import Prepared, PreparedRun
from wearscope.closed_loop.model.regression import Entry, Regression
from wearscope.closed_loop.model.joint_flexibility import (
    estimate_transmission,
    find_held,
    solve_transmission,
    transmits,
    trust_jumps,
)
from wearscope.effects.base import MeasurementEffect


@dataclass
class Predicted:
    """Torque (M, n) that each stage predicts along one run, at the common bandwidth."""

    run: PreparedRun
    declared: np.ndarray
    before: np.ndarray
    after: np.ndarray


def is_late(entry: Entry) -> bool:
    """Whether an entry is an error of the measurement, acting on what the rest of the model predicts."""
    return isinstance(entry.effect, MeasurementEffect)


def predict_motor(
    model: Regression, theta: np.ndarray, run: PreparedRun, shares: dict[int, float] | None = None
) -> np.ndarray:
    """Full-rate torque (N, n) of the motors, before errors of the measurement.

    Gears bend under `signals.transmitted`. Of the entries in `shares`, by index, only a share of the torque
    is taken.
    """
    s = run.signals
    torque = run.known.copy()
    if model.inertial:
        count = 10 * model.prepared.n
        torque += s.rigid_body.inertial_regressor(s.q, s.v, s.a) @ theta[:count]
    for i, (entry, span) in enumerate(zip(model.entries, model.spans, strict=True)):
        if not is_late(entry):
            torque += (shares or {}).get(i, 1.0) * (entry.columns(run) @ theta[span])
    return torque


def predict_full(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Full-rate torque (N, n) that a model predicts to be recorded along a run."""
    s = run.signals
    kept, s.transmitted = s.transmitted, _solve_if_soft(model, theta, run)
    motor = predict_motor(model, theta, run, trust_jumps(model, theta))
    s.transmitted = kept
    return _record(model, theta, run, motor)


def _solve_if_soft(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray | None:
    soft = any(transmits(entry) for entry in model.entries)
    return solve_transmission(model, theta, run) if soft else None


def _record(model: Regression, theta: np.ndarray, run: PreparedRun, motor: np.ndarray) -> np.ndarray:
    """Recorded torque (N, n) of motors that give the torque `motor`."""
    s = run.signals
    torque = motor.copy()
    kept = s.torque, s.lag
    s.torque, s.lag = motor, find_lags(model, theta)
    for entry, span in zip(model.entries, model.spans, strict=True):
        if is_late(entry):
            torque += entry.columns(run) @ theta[span]
    s.torque, s.lag = kept
    return torque


def find_lags(model: Regression, theta: np.ndarray) -> np.ndarray:
    """Delay [s] of each torque channel (n,) in a model."""
    lags = np.zeros(model.prepared.n)
    for entry, span in zip(model.entries, model.spans, strict=True):
        if isinstance(entry.effect, MeasurementEffect) and entry.effect.kind == "lag":
            lags[entry.joint] = theta[span][0]
    return lags


def update_prediction(model: Regression) -> None:
    """Give the training signals the motors' and the gears' torque of a model.

    Errors of the measurement act on the first, deflections of the gears on the second.
    """
    theta = model.solve()
    for run in model.prepared.runs_for("train"):
        s = run.signals
        s.transmitted = _solve_if_soft(model, theta, run)
        s.torque, s.lag = predict_motor(model, theta, run), find_lags(model, theta)
        s.transmitted = estimate_transmission(model, theta, run, _record(model, theta, run, s.torque))


def refit(base: Regression, entries: list[Entry]) -> Regression:
    """Regression like `base` with other entries.

    Errors of the measurement multiply the motor torque, and gears bend under a torque, that the other
    parameters give: the fit is repeated until both agree.
    """
    model = Regression(base.prepared, entries, base.sigma, base.inertial, base.blocks)
    if any(is_late(entry) or transmits(entry) for entry in entries):
        for _ in range(4):
            update_prediction(model)
            model = Regression(
                base.prepared, entries, base.sigma, base.inertial, base.blocks, find_held(model)
            )
    return model


def predict_runs(prepared: Prepared, before: Regression, after: Regression) -> list[Predicted]:
    """Predictions along all runs."""
    theta = before.solve(), after.solve()
    return [
        Predicted(
            run,
            run.reduce(run.known),
            run.reduce(predict_full(before, theta[0], run)),
            run.reduce(predict_full(after, theta[1], run)),
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


def bootstrap_rms(
    parts: list[tuple[np.ndarray, np.ndarray]], rows: int, seed: int, draws: int = 400
) -> np.ndarray:
    """95 % interval (2, n) of the pooled rms, resampling blocks of `rows` rows."""
    squares, counts = [], []
    for residual, keep in parts:
        for start in range(0, len(residual), rows):
            block = slice(start, start + rows)
            squares.append((residual[block] ** 2 * keep[block]).sum(axis=0))
            counts.append(keep[block].sum(axis=0))
    square, count = np.array(squares), np.array(counts)
    rng = np.random.default_rng(np.random.SeedSequence([seed, len(square)]))
    pick = rng.integers(0, len(square), (draws, len(square)))
    with np.errstate(invalid="ignore", divide="ignore"):
        value = np.sqrt(square[pick].sum(axis=1) / count[pick].sum(axis=1))
    return np.quantile(value, [0.025, 0.975], axis=0)


def find_repeats(prepared: Prepared) -> list[tuple[int, int]]:
    """Pairs of runs that follow the same trajectory under the same payload."""
    pairs = []
    runs = prepared.runs
    payload = {run.file: run.payload for run in prepared.dataset.runs}
    for i in range(len(runs)):
        for k in range(i + 1, len(runs)):
            a, b = runs[i].signals.q, runs[k].signals.q
            short = min(len(a), len(b))
            if short < 0.9 * max(len(a), len(b)) or payload[runs[i].file] != payload[runs[k].file]:
                continue
            reach = np.maximum(np.ptp(a, axis=0), 1e-9)
            apart = np.sqrt(np.mean((a[:short] - b[:short]) ** 2, axis=0)) / reach
            if np.all(apart[prepared.moving] < 0.01):
                pairs.append((i, k))
    return pairs


def noise_floor(prepared: Prepared, predicted: list[Predicted]) -> np.ndarray | None:
    """Rms of what does not repeat when the motion does (n,), or None where no motion is repeated.

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
