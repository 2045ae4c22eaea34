"""Refuses impossible signals: positions beyond limits, speeds that are no slopes, dead encoders."""

from collections.abc import Callable

import numpy as np

from wearscope.closed_loop.intake.cleaning import QUANTA
from wearscope.closed_loop.intake.filtering import differentiate, low_pass
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.recording import estimate_quantum
from wearscope.closed_loop.intake.traits.hypotheses import NOTE, say_clock
from wearscope.robots.urdf import OPEN_LIMIT, parse_urdf

#: Speed factors of joints count as equal where their logarithms differ from the median's by less than this.
_ONE_FACTOR = 0.1


def check_signals(prepared: Prepared, run: PreparedRun, explained: np.ndarray) -> None:
    """Refuse positions of a run that lie far beyond the limits or come from a dead encoder.

    Parameters
    ----------
    prepared : Prepared
    run : PreparedRun
    explained : ndarray (n,) of bool
        Joints whose torque the stated positions explain; their limits are not checked.

    Raises
    ------
    InputError
    """
    _check_limits(prepared, run, explained)
    _check_frozen(prepared, run)


def _check_limits(prepared: Prepared, run: PreparedRun, explained: np.ndarray) -> None:
    """Refuse positions far outside the URDF's limits that no zero offset and no other reading explains."""
    for joint in parse_urdf(prepared.urdf).joints:
        j = prepared.dataset.joints.index(joint.name)
        widest = max(abs(joint.lower), abs(joint.upper))
        slides = prepared.dataset.position_unit[j] == "m"
        reach = float(np.abs(run.signals.q[:, j]).max())
        beyond = widest < 0.1 * OPEN_LIMIT and reach > 2.0 * widest + (0.2 if slides else 2 * np.pi)
        if beyond and not explained[j]:
            unit, other = ("m", "mm") if slides else ("rad", "degrees")
            told = (
                f"column 'q_{joint.name}' reaches {reach:.3g}, where the URDF's limits are {joint.lower:.3g} "
                f"to {joint.upper:.3g} {unit}; if it is in {other} or before the gear, convert it to the "
                f"joint's {unit}."
            )
            prepared.refuse(str(prepared.dataset.folder / run.file), told, f"limits q_{joint.name}")


def check_speeds(prepared: Prepared, ask_clock: Callable[[float], float]) -> None:
    """Refuse given speeds that are not the derivative of the cleaned positions, in each run's first piece.

    Where the speeds of all moving joints are off by the same factor, the clock is wrong or their unit is.

    Parameters
    ----------
    prepared : Prepared
    ask_clock : callable
        ``ask_clock(factor)`` returns the torques' evidence [nats] for a clock that is wrong by a factor.

    Raises
    ------
    InputError
    """
    gains = {
        (run.label, j): (run, *one)
        for run in prepared.runs
        if run.piece < 2
        for j, one in _compare_speeds(prepared, run).items()
    }
    off = {key: gain for key, (_, gain, alike) in gains.items() if not (0.8 < gain < 1.25 and alike > 0.8)}
    if not off:
        return
    alike = min(alike for _, _, alike in gains.values())
    factor = float(np.median([gain for _, gain, _ in gains.values()]))
    one = max(
        abs(np.log(gain / factor)) if min(gain, factor) > 0.0 else np.inf for _, gain, _ in gains.values()
    )
    for_clock = ask_clock(1.0 / factor) if alike > 0.8 and one < _ONE_FACTOR else -np.inf
    if for_clock > -NOTE:
        told, codes = say_clock(1.0 / factor)
        if for_clock < NOTE:
            told += (
                "; or, which the torques do not tell from it, the speeds are in another unit: convert them"
            )
        told = f"every speed column is {factor:.3g} times the slope of its position: {told}"
        prepared.refuse(str(prepared.dataset.folder), f"{told}, or leave the columns out.", *codes)
        return
    for (_, j), gain in off.items():
        run, _, alike = gains[next(key for key in gains if key[1] == j and off.get(key) == gain)]
        joint = prepared.dataset.joints[j]
        told = (
            f"column 'qd_{joint}' is {gain:.3g} times the slope of 'q_{joint}' (correlation {alike:.2f}); "
            "give the joint's speed in rad/s or m/s, or leave the column out."
        )
        prepared.refuse(str(prepared.dataset.folder / run.file), told, f"speed qd_{joint}")


def _compare_speeds(prepared: Prepared, run: PreparedRun) -> dict[int, tuple[float, float]]:
    """Ratio of recorded speed to the position's slope, and their correlation, for each joint that moves."""
    recorded, found = prepared.record_of(run).load(), {}
    if recorded.qd is None:
        return {}
    slope = differentiate(low_pass(run.signals.q, run.band.torque, run.band.rate), run.band.rate)
    for j in np.flatnonzero(prepared.moving & np.isfinite(recorded.qd).all(axis=0)).tolist():
        given = low_pass(recorded.qd[:, [j]], run.band.torque, prepared.dataset.fields.sample_rate)[:, 0]
        given = np.interp(run.signals.t, recorded.t, given)
        both = float(given @ slope[:, j])
        size = max(float(slope[:, j] @ slope[:, j]), 1e-300)
        alike = both / max(float(np.linalg.norm(given) * np.linalg.norm(slope[:, j])), 1e-300)
        if np.ptp(run.signals.q[:, j]) > max(1e-3, 10.0 * float(estimate_quantum(recorded.q[:, [j]])[0])):
            found[j] = (both / size, alike)
    return found


def _check_frozen(prepared: Prepared, run: PreparedRun) -> None:
    """Refuse a position that never changes while its torque swings as in motion, which is a dead encoder.

    The torque of a locked joint may change too: its brake and its motor share the load that the other joints'
    motion makes. A torque of mere noise is recognised by its share above the common cut-off.
    """
    recorded = prepared.record_of(run)
    for j in np.flatnonzero(recorded.reach == 0.0).tolist():
        load = run.reduce(run.known[:, [j]])[:, 0]
        swing, torque = _span(run.measured[:, j] - load), _span(run.measured[:, j])
        usual = max(_span(other.measured[:, j]) for other in prepared.runs)
        if torque < QUANTA * float(estimate_quantum(run.tau[:, [j]])[0]):
            continue
        steady = run.measured[:, j].var() > 0.5 * run.tau[:, j].var()
        if steady and min(swing, torque) > 0.5 * usual and swing + torque > 1.6 * _span(load):
            joint = prepared.dataset.joints[j]
            told = (
                f"column 'q_{joint}' never changes while 'tau_{joint}' swings by {torque:.3g}; the encoder's "
                "channel is dead, record the run again or leave it out."
            )
            prepared.refuse(str(prepared.dataset.folder / run.file), told, f"frozen q_{joint}")


def _span(x: np.ndarray) -> float:
    return float(np.ptp(np.percentile(x, [2, 98])))
