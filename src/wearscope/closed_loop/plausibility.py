"""Whether signals can be what the data set says they are: units, torque side, signs, channel order.

The check is made against the declared model's own prediction, so that it holds for any robot: a data set whose
torque is explained far better by another reading of its columns than by the stated one is refused.
"""

import numpy as np

from wearscope.closed_loop.preparation import Prepared, PreparedRun
from wearscope.errors import InputError

#: A reading must explain at least this share of the torque variance to be believed instead of the stated one.
_CONVINCING = 0.7
_POOR = 0.3


def _explained(y: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Share of the variance of y that x explains with friction beside it, and x's coefficient."""
    theta, *_ = np.linalg.lstsq(x, y, rcond=None)
    total = ((y - y.mean()) ** 2).sum()
    return float(1 - ((y - x @ theta) ** 2).sum() / max(total, 1e-300)), float(theta[0])


def _rows(run: PreparedRun, x: np.ndarray) -> np.ndarray:
    return run.reduce(x)


def _regressors(runs: list[PreparedRun], j: int, known: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    y, x = [], []
    for run, k in zip(runs, known, strict=True):
        s = run.signals
        full = np.column_stack([k[:, j], s.sign[:, j], s.v[:, j], np.ones(len(k))])
        x.append(_rows(run, full)[run.keep[:, j]])
        y.append(run.measured[:, j][run.keep[:, j]])
    return np.concatenate(y), np.concatenate(x)


def check_plausibility(prepared: Prepared) -> None:
    """Refuse data that another reading of the columns explains and the stated one does not.

    Raises
    ------
    InputError
    """
    _check_speeds(prepared)
    for use in ("train", "test"):
        runs = prepared.runs_for(use)
        _check_torque_scale(prepared, runs)
        _check_channels(prepared, runs)


def _check_speeds(prepared: Prepared) -> None:
    """Degrees for radians and millimetres for metres show as impossible positions and speeds."""
    dataset = prepared.dataset
    for run in prepared.runs:
        s = run.signals
        for j, joint in enumerate(dataset.joints):
            reach, speed = np.abs(s.q[:, j]).max(), np.abs(s.v[:, j]).max()
            slides = dataset.position_unit[j] == "m"
            most = (20.0, 20.0) if slides else (4 * np.pi + 2.0, 30.0)
            if reach > most[0] or speed > most[1]:
                unit, other = ("m", "mm") if slides else ("rad", "degrees")
                raise InputError(
                    f"{dataset.folder / run.file}: column 'q_{joint}' reaches {reach:.3g} at up to {speed:.3g} a "
                    f"second, which no joint does in {unit}; if it is in {other}, convert it to {unit}."
                )


def _check_torque_scale(prepared: Prepared, runs: list[PreparedRun]) -> None:
    """Motor-side torque, newton-millimetres and opposite signs show in the gain of the rigid body."""
    dataset = prepared.dataset
    gains, shares = [], []
    for j in np.flatnonzero(prepared.moving):
        y, x = _regressors(runs, j, [run.known for run in runs])
        if len(y) < 50:
            continue
        with_body, gain = _explained(y, x)
        without, _ = _explained(y, x[:, 1:])
        if with_body > 0.8 and with_body - without > 0.5 * (1 - without):
            gains.append(gain)
            shares.append(with_body)
    if not gains:
        return
    gain = float(np.median(gains))
    where = f"{dataset.folder}: the {runs[0].use} runs' torque"
    if gain < -0.3:
        raise InputError(
            f"{where} is {gain:.2g} times what the rigid body needs; the sign is opposite: give motor torque, "
            "positive where it does positive work in positive motion."
        )
    if 0 <= gain < 0.25 or gain > 4.0:
        ratio = dataset.fields.robot.gear_ratio
        hint = "give torque on the joint side of the gear in N m"
        if ratio is not None and 0.3 < gain * float(np.median(np.abs(ratio))) < 3.0:
            hint = "it looks like motor-side torque: multiply it with the gear ratio"
        raise InputError(f"{where} is {gain:.3g} times what the rigid body needs; {hint}.")


def _check_channels(prepared: Prepared, runs: list[PreparedRun]) -> None:
    """Swapped columns: torques that are explained once two joints' channels are exchanged."""
    dataset = prepared.dataset
    n = prepared.n
    own = np.full(n, np.nan)
    for j in np.flatnonzero(prepared.moving):
        y, x = _regressors(runs, j, [run.known for run in runs])
        if len(y) >= 50:
            own[j] = _explained(y, x)[0]
    doubtful = [j for j in range(n) if np.isfinite(own[j]) and own[j] < _CONVINCING]
    for a in doubtful:
        for b in range(n):
            if a == b or (b in doubtful and b < a) or not np.isfinite(own[b]):
                continue
            torque, motion = _swapped(prepared, runs, a, b)
            before = 2 - own[a] - own[b]
            for value, kind in ((torque, "tau"), (motion, "q")):
                if value.min() > _CONVINCING and 2 - value.sum() < _POOR * before:
                    raise InputError(
                        f"{dataset.folder}: columns '{kind}_{dataset.joints[a]}' and '{kind}_{dataset.joints[b]}' "
                        f"of the {runs[0].use} runs look swapped; exchange them."
                    )


def _swapped(prepared: Prepared, runs: list[PreparedRun], a: int, b: int) -> tuple[np.ndarray, np.ndarray]:
    """Explained shares of joints a and b with their torques exchanged, and with their positions exchanged."""
    order = np.arange(prepared.n)
    order[[a, b]] = b, a
    torque, motion = [], []
    known = []
    for run in runs:
        s = run.signals
        q, v, acc = s.q[:, order], s.v[:, order], s.a[:, order]
        known.append(s.rigid_body.inverse_dynamics(q, v, acc) + (run.known - s.load)[:, order])
    for j, other in ((a, b), (b, a)):
        y, x, xm = [], [], []
        for run, k in zip(runs, known, strict=True):
            keep = run.keep[:, a] & run.keep[:, b]
            s = run.signals
            y.append((run.measured[:, other][keep], run.measured[:, j][keep]))
            full = np.column_stack([run.known[:, j], s.sign[:, j], s.v[:, j], np.ones(len(k))])
            x.append(_rows(run, full)[keep])
            full = np.column_stack([k[:, j], s.sign[:, other], s.v[:, other], np.ones(len(k))])
            xm.append(_rows(run, full)[keep])
        torque.append(_explained(np.concatenate([p[0] for p in y]), np.concatenate(x))[0])
        motion.append(_explained(np.concatenate([p[1] for p in y]), np.concatenate(xm))[0])
    return np.array(torque), np.array(motion)
