"""Torque through the gears, which bends them.

Along the motor's measured motion the rigid body's torque is not what a soft gear carries: the link lags and
rings. There are two better estimates below `Band.gear`. One solves tau = rigid body(motor motion -
deflection(tau)) from the motion alone. The other is the measured torque less the model's torque on the
motor's side. Evidence and predictions use only the first. The second holds the noise of the torque that is to
be explained, so it is a regressor of estimates only, with a torque from the motion as its instrument.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np
from scipy import fft
from scipy.sparse.linalg import LinearOperator, gmres

from wearscope.closed_loop.intake.filtering import Band, low_pass
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Signals

#: Largest (w/w0)^2 at which the motion alone gives a gear's torque: w is the common cut-off, w0 the frequency
#: at which the link swings.
_STIFF = 0.5
#: Damping about w0 and beyond; number of corrections of the torque through a gear.
_DAMPING, PASSES = 1.0, 4
#: Where the corrections diverge: most steps of GMRES, and relative residual at which it ends.
_STEPS, _PRECISE = 12, 1e-3


def rigid_link_torque(model: Regression, theta: np.ndarray, signals: Signals) -> np.ndarray:
    """Full-rate torque (N, n) on the link side of rigid gears, along the motors' motion."""
    s = signals
    torque = s.rigid_body.inverse_dynamics(s.q, s.v, s.a)
    if model.inertial:
        torque += s.rigid_body.add_to_links(theta[: 10 * model.prepared.n], s.q, s.v, s.a)
    return add_terms(
        torque, model, theta, signals, lambda term: term.effect.spread and not term.is_deflection
    )


def add_terms(
    torque: np.ndarray,
    model: Regression,
    theta: np.ndarray,
    signals: Signals,
    chosen: Callable[[ModelTerm], bool],
) -> np.ndarray:
    """Add the chosen terms' torque along signals to a torque (N, n), which is changed and returned."""
    for term, span in zip(model.entries, model.spans, strict=True):
        if chosen(term):
            torque += term.columns(signals) @ theta[span]
    return torque


def bending_torque(model: Regression, theta: np.ndarray, signals: Signals) -> np.ndarray:
    """Change (N, n) of the links' torque by the deflection of the gears under `signals.transmitted`."""
    return add_terms(np.zeros_like(signals.load), model, theta, signals, lambda term: term.is_deflection)


def softness(model: Regression, theta: np.ndarray, signals: Signals) -> np.ndarray:
    """Inverse square (n,) of the angular frequency [s^2] at which each link swings against a held motor.

    Zero for a rigid gear, infinite for one whose deflection jumps.
    """
    soft = np.zeros(model.prepared.n)
    for term, span in zip(model.entries, model.spans, strict=True):
        if term.is_deflection:
            inertia = float(np.mean(signals.load_slopes(term.joint)[2][:, term.joint]))
            jumps = bool(getattr(term.effect, "abrupt", False))
            soft[term.joint] += np.inf if jumps else max(float(theta[span][0]), 0.0) * inertia
    return soft


def take_out_swing(stiff: np.ndarray) -> np.ndarray:
    """Gain by frequency of a correction that undoes the swing of a link against its motor.

    It is 1 / `stiff` below the swing. It is damped near the swing and beyond: there the motor's motion shows
    next to nothing of the link's, and its noise would ring.

    Parameters
    ----------
    stiff : ndarray
        1 - (w / w0)^2 by frequency: how the gears' equation responds to a correction of the torque.
    """
    return np.asarray(stiff / (stiff**2 + _DAMPING * (stiff < 0.5)))


def solve_gears(model: Regression, theta: np.ndarray, run: PreparedRun) -> np.ndarray | None:
    """Torque (N, n) through the gears below `Band.gear` from the model and the motors' motion alone.

    For deflections proportional to the torque the equation is linear. A few corrections solve it, in which
    the swing of the mean inertia is taken out (`take_out_swing`); more would ring at the swing. Where they
    diverge, GMRES solves it. Across a jump of the deflection the rigid body's torque below
    `Prepared.lost_motion_cutoff` is the best that the motion gives. None where the model has no deflection.
    """
    if not any(term.is_deflection for term in model.entries):
        return None
    s, band = run.signals, run.band
    soft = softness(model, theta, s)
    jumps = np.isinf(soft)
    rigid = rigid_link_torque(model, theta, s)
    given = low_pass(rigid, band.gear, band.rate)
    for j in np.flatnonzero(jumps):
        given[:, [j]] = low_pass(rigid[:, [j]], float(model.prepared.lost_motion_cutoff[j]), band.rate)
    bends = (soft > 0) & ~jumps
    if not bends.any():
        return given
    size = fft.next_fast_len(2 * len(s.t))
    square = (2 * np.pi * fft.rfftfreq(size, 1.0 / band.rate)) ** 2
    stiff = 1.0 - square[:, None] * soft[bends]
    gain = take_out_swing(stiff)

    def correct(x: np.ndarray) -> np.ndarray:
        return np.asarray(fft.irfft(fft.rfft(x, size, axis=0) * gain, size, axis=0)[: len(x)])

    def miss(x: np.ndarray) -> np.ndarray:
        through = given.copy()
        through[:, bends] = x
        bent = bending_torque(model, theta, replace(s, transmitted=through))[:, bends]
        return given[:, bends] + low_pass(bent, band.gear, band.rate) - x

    found, left = given[:, bends].copy(), np.inf
    for _ in range(PASSES):
        missed = miss(found)
        if float(np.sum(missed**2)) > left:
            found = _solve_whole(miss, correct, given[:, bends])
            break
        left = float(np.sum(missed**2))
        found = found + correct(missed)
    solved = given.copy()
    solved[:, bends] = low_pass(found, band.gear, band.rate)
    return solved


def _solve_whole(
    miss: Callable[[np.ndarray], np.ndarray], correct: Callable[[np.ndarray], np.ndarray], given: np.ndarray
) -> np.ndarray:
    """Torque (N, m) that solves the equation, by GMRES with `correct` as preconditioner, stopped early.

    Saad and Schultz 1986. Corrections for a mean inertia diverge where the inertia changes by much.

    Parameters
    ----------
    miss : callable
        Residual (N, m) of the equation at a torque (N, m): an affine function.
    correct : callable
    given : ndarray (N, m)
        Torque of rigid gears.
    """
    still = miss(np.zeros_like(given))

    def apply(x: np.ndarray) -> np.ndarray:
        return np.asarray((still - miss(correct(x.reshape(given.shape)))).ravel())

    operator = LinearOperator((given.size, given.size), matvec=apply, dtype=float)
    found, _ = gmres(operator, still.ravel(), rtol=_PRECISE, restart=_STEPS, maxiter=1)
    return correct(found.reshape(given.shape))


def find_jump_shares(model: Regression, theta: np.ndarray) -> dict[int, float]:
    """Share of each jumping deflection's torque, by term, that the motion alone predicts.

    The motion shows the time of a jump only roughly. Averaged over the possible times, the torque is smaller
    than at the true one. The share is the slope of the training residual against that torque, 0 to 1.
    """
    terms = [i for i, e in enumerate(model.entries) if e.is_deflection and getattr(e.effect, "abrupt", False)]
    own = {i: np.zeros(2) for i in terms}
    if not terms:
        return {}
    for run, x, y, w in zip(
        model.prepared.runs_for("train"), model.columns, model.target, model.weights, strict=True
    ):
        signals = replace(run.signals, transmitted=solve_gears(model, theta, run))
        for i in terms:
            span = model.spans[i]
            predicted = (run.reduce_columns(model.entries[i].columns(signals)) @ theta[span]) * w
            left = (y - x @ theta + x[:, :, span] @ theta[span]) * w
            own[i] += np.sum(predicted * left), np.sum(predicted**2)
    return {i: float(np.clip(a / max(b, 1e-300), 0.0, 1.0)) for i, (a, b) in own.items()}


def measure_gears(
    model: Regression, theta: np.ndarray, run: PreparedRun, solved: np.ndarray | None, predicted: np.ndarray
) -> np.ndarray | None:
    """Torque (N, n) through the gears of a training run, as a regressor of estimates.

    Parameters
    ----------
    model : Regression
    theta : ndarray (P,)
    run : PreparedRun
    solved : ndarray (N, n) or None
        From `solve_gears`; taken where the motion alone tells the torque, and the measured torque elsewhere.
    predicted : ndarray (N, n)
        Recorded torque that the model predicts.
    """
    if solved is None:
        return None
    signals, band = replace(run.signals, transmitted=solved), run.band
    link = rigid_link_torque(model, theta, signals) + bending_torque(model, theta, signals)
    measured = low_pass(link + run.tau - predicted, band.gear, band.rate)
    return np.where(is_solvable(softness(model, theta, run.signals), band), solved, measured)


def is_solvable(soft: np.ndarray, band: Band) -> np.ndarray:
    """Whether the motion alone tells the torque of gears of a given softness (n,)."""
    return (soft > 0) & (soft * (2 * np.pi * band.torque) ** 2 < _STIFF)


def make_instruments(model: Regression, held: Collection[int]) -> list[np.ndarray]:
    """Columns (M, n, P) of each training run without the noise of the measured torque.

    The terms `held`, by index, are gears that bend along the measured torque. Their columns are computed
    along the rigid body's torque instead, and so correlate with the original ones, but not with the noise.
    All other columns are the model's.
    """
    made = []
    for columns, run in zip(model.columns, model.prepared.runs_for("train"), strict=True):
        if held:
            columns = columns.copy()
            for i in held:
                columns[:, :, model.spans[i]] = run.reduce_columns(model.entries[i].columns(run.signals))
        made.append(columns)
    return made


def estimate_by_instruments(model: Regression) -> dict[int, np.ndarray]:
    """Compliances of the gears that bend along the measured torque, by instrumental variables.

    Least squares would take the noise that the regressor has in common with the target for a stiffer gear
    (Durbin 1954; Young 2011, Recursive Estimation).
    """
    theta = model.solve()
    run = model.prepared.runs_for("train")[0]
    soft = softness(model, theta, run.signals)
    joints = np.flatnonzero((soft > 0) & np.isfinite(soft) & ~is_solvable(soft, run.band))
    held = [i for i, term in enumerate(model.entries) if term.is_deflection and term.joint in joints]
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
