"""Torque through the gears, which bends them.

Along the motor's measured motion the rigid body's torque is not what a soft gear carries: the link lags and
rings. Two better figures are at hand below `Band.gear`: the measured torque less what the model has on the
motor's side, and the solution of tau = rigid body(motor motion - deflection(tau)). The first needs the
measurement of the torque that is to be explained, and its noise; the second has no answer near the frequency
where a link swings against a held motor, nor across a jump of the deflection, where the rigid body's torque
below half the common cut-off is the nearest that the motion gives.
"""

from collections.abc import Collection

import numpy as np
from scipy import fft
from scipy.sparse.linalg import LinearOperator, gmres

from wearscope.closed_loop.intake.filtering import Band, low_pass
from wearscope.closed_loop.intake.preprocessing import PreparedRun
from wearscope.closed_loop.model.regression import Entry, Regression
from wearscope.effects.base import TransmissionEffect

#: (w/w0)^2 at the common cut-off up to which a model alone gives a gear's torque, w0 where the link swings.
_STIFF = 0.5
#: Damping of the preconditioner near w0, most steps, residual at which they end.
_DAMPING, _STEPS, _PRECISE = 1.0, 12, 1e-3


def transmits(entry: Entry) -> bool:
    """Whether an entry is a deflection of a gear."""
    return isinstance(entry.effect, TransmissionEffect)


def link_torque(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Full-rate torque (N, n) that a model has on the link side of the gears."""
    return rigid_link_torque(model, theta, run) + bending_torque(model, theta, run)


def rigid_link_torque(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """What of `link_torque` there is along the motors' motion, were the gears rigid."""
    s = run.signals
    torque = s.load.copy()
    if model.inertial:
        torque += s.rigid_body.inertial_regressor(s.q, s.v, s.a) @ theta[: 10 * model.prepared.n]
    for entry, span in zip(model.entries, model.spans, strict=True):
        if entry.effect.spread and not transmits(entry):
            torque += entry.columns(run) @ theta[span]
    return torque


def bending_torque(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """What the deflection of the gears changes in `link_torque`."""
    torque = np.zeros_like(run.signals.load)
    for entry, span in zip(model.entries, model.spans, strict=True):
        if transmits(entry):
            torque += entry.columns(run) @ theta[span]
    return torque


def softness(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Inverse square (n,) of the angular frequency [s^2] at which each link swings against a held motor.

    Zero for a rigid gear, infinite for one whose deflection jumps.
    """
    soft = np.zeros(model.prepared.n)
    for entry, span in zip(model.entries, model.spans, strict=True):
        if isinstance(entry.effect, TransmissionEffect):
            inertia = float(np.mean(run.signals.load_slopes(entry.joint)[2][:, entry.joint]))
            soft[entry.joint] += np.inf if entry.effect.abrupt else max(float(theta[span][0]), 0.0) * inertia
    return soft


def solve_transmission(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Torque (N, n) through the gears below `Band.gear` from the model and the motors' motion alone.

    For deflections proportional to the torque the equation is linear: GMRES (Saad and Schultz 1986) with the
    swing of the mean inertia as preconditioner, stopped early, since there is nothing to find at resonance.
    """
    s, band = run.signals, run.band
    kept = s.transmitted
    soft = softness(model, theta, run)
    jumps = np.isinf(soft)
    rigid = rigid_link_torque(model, theta, run)
    given = low_pass(rigid, band.gear, band.rate)
    given[:, jumps] = low_pass(rigid[:, jumps], 0.5 * band.torque, band.rate)
    bends = (soft > 0) & ~jumps
    if not bends.any():
        return given
    size = fft.next_fast_len(2 * len(s.t))
    square = (2 * np.pi * fft.rfftfreq(size, 1.0 / band.rate)) ** 2
    stiff = 1.0 - square[:, None] * soft[bends]
    gain = stiff / (stiff**2 + _DAMPING * (stiff < 0.5))
    shape = (len(s.t), int(bends.sum()))

    def change(x: np.ndarray) -> np.ndarray:
        s.transmitted = given.copy()
        s.transmitted[:, bends] = x
        return low_pass(bending_torque(model, theta, run)[:, bends], band.gear, band.rate)

    still = change(np.zeros(shape))

    def apply(x: np.ndarray) -> np.ndarray:
        swung = precondition(x)
        return (swung - change(swung) + still).ravel()

    def precondition(x: np.ndarray) -> np.ndarray:
        return fft.irfft(fft.rfft(x.reshape(shape), size, axis=0) * gain, size, axis=0)[: shape[0]]

    target = (given[:, bends] + still).ravel()
    length = len(target)
    operator = LinearOperator((length, length), matvec=apply, dtype=float)
    found, _ = gmres(operator, target, rtol=_PRECISE, restart=_STEPS, maxiter=1)
    solved = given.copy()
    solved[:, bends] = low_pass(precondition(found), band.gear, band.rate)
    s.transmitted = kept
    return solved


def trust_jumps(model: Regression, theta: np.ndarray) -> dict[int, float]:
    """Share of each jumping deflection's torque, by entry, that can be foretold from the motion alone.

    The moment of a jump is known from the motion only roughly, and the expectation of a torque about an
    uncertain moment is less than the torque: the share is the slope of the training residual on it, 0 to 1.
    """
    entries = [
        i for i, e in enumerate(model.entries) if isinstance(e.effect, TransmissionEffect) and e.effect.abrupt
    ]
    if not entries or model.trusted is not None:
        return model.trusted or {}
    own = {i: np.zeros(2) for i in entries}
    for run, x, y, w in zip(
        model.prepared.runs_for("train"), model.columns, model.target, model.weights, strict=True
    ):
        kept = run.signals.transmitted
        run.signals.transmitted = solve_transmission(model, theta, run)
        for i in entries:
            span = model.spans[i]
            foretold = (run.reduce(model.entries[i].columns(run)) @ theta[span]) * w
            left = (y - x @ theta + x[:, :, span] @ theta[span]) * w
            own[i] += np.sum(foretold * left), np.sum(foretold**2)
        run.signals.transmitted = kept
    model.trusted = {i: float(np.clip(a / max(b, 1e-300), 0.0, 1.0)) for i, (a, b) in own.items()}
    return model.trusted


def estimate_transmission(
    model: Regression, theta: np.ndarray, run: PreparedRun, predicted: np.ndarray
) -> np.ndarray:
    """Torque (N, n) through the gears of a training run, from its measured torque where a model cannot tell.

    Parameters
    ----------
    model : Regression
    theta : ndarray (P,)
    run : PreparedRun
        With the solved torque in `signals.transmitted` if the model has soft gears.
    predicted : ndarray (N, n)
        Recorded torque that the model predicts.
    """
    s, band = run.signals, run.band
    measured = low_pass(link_torque(model, theta, run) + run.tau - predicted, band.gear, band.rate)
    if s.transmitted is None:
        return measured
    return np.where(is_solvable(softness(model, theta, run), band), s.transmitted, measured)


def is_solvable(soft: np.ndarray, band: Band) -> np.ndarray:
    """Whether a model alone tells the torque of gears of a given softness (n,)."""
    return (soft > 0) & (soft * (2 * np.pi * band.torque) ** 2 < _STIFF)


def make_instruments(model: Regression, held: Collection[int]) -> list[np.ndarray]:
    """Columns (M, n, P) of each training run without the noise of the measured torque.

    Those of the entries `held`, by index, which are gears along the measured torque, are replaced by those
    along the rigid body's, which go with them and not with the noise; the others are the model's.
    """
    made = []
    for columns, run in zip(model.columns, model.prepared.runs_for("train"), strict=True):
        if held:
            columns = columns.copy()
            kept, run.signals.transmitted = run.signals.transmitted, None
            for i in held:
                columns[:, :, model.spans[i]] = run.reduce(model.entries[i].columns(run))
            run.signals.transmitted = kept
        made.append(columns)
    return made


def find_held(model: Regression) -> dict[int, np.ndarray]:
    """Compliances of the gears that bend along the measured torque, by instrumental variables.

    Least squares would take the noise that the regressor has in common with the target for a stiffer gear
    (Durbin 1954; Young 2011, Recursive Estimation).
    """
    theta = model.solve()
    run = model.prepared.runs_for("train")[0]
    soft = softness(model, theta, run)
    joints = np.flatnonzero((soft > 0) & np.isfinite(soft) & ~is_solvable(soft, run.band))
    held = [i for i, entry in enumerate(model.entries) if transmits(entry) and entry.joint in joints]
    if not held:
        return {}
    gram, score = model.weak_prior.copy(), np.zeros(model.p)
    for z, x, y, w in zip(
        make_instruments(model, held), model.columns, model.target, model.weights, strict=True
    ):
        z, x, y = (z * w[:, :, None]).reshape(-1, model.p), (x * w[:, :, None]).reshape(-1, model.p), y * w
        gram += z.T @ x
        score += z.T @ y.ravel()
    found = np.linalg.solve(gram, score)
    return {i: np.maximum(found[model.spans[i]], 0.0) for i in held}
