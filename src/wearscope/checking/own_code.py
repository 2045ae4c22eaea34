"""A file of one's own: a detector, test-cycle or effect, tried on what the platform has."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wearscope import plugins
from wearscope.checking.robot import USUAL
from wearscope.cycles.base import load_cycle, required_torque
from wearscope.detectors.base import Batch, load_detector
from wearscope.effects.base import Signals, load_effect
from wearscope.errors import Findings, InputError, tell_error
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.feasibility import check_cycle

#: Names that a file may define, and their kinds.
KINDS = {"DETECTOR": "detector", "CYCLE": "test-cycle", "EFFECT": "effect"}
#: Robots that own code is tried on.
ROBOTS = ("medium", "large")
_RATE = 250.0


def make_batch(model: RobotModel, cycle: str, wear: float, seed: int, temperature: float = 50.0) -> Batch:
    """Recording of a test-cycle as the model itself predicts it, with the noise of its sensors.

    Nothing is simulated, so this is quick: the motion is the reference, and the torque is what the model
    needs along it.

    Parameters
    ----------
    model : RobotModel
    cycle : str
        As `wearscope.cycles.base.load_cycle` takes it.
    wear : float
        Level f of all wearing joints [-].
    seed : int
        Of the noise.
    temperature : float
        [deg C]
    """
    reference = load_cycle(cycle).build(model, 0.05, 1.0 / _RATE)
    torque = required_torque(reference, model, temperature, wear, 1.0)
    noise = np.random.default_rng(seed).normal(size=torque.shape) * model.torque_noise
    return Batch(reference.t, reference.q, reference.v, torque + noise, _RATE)


def check_detector(path: str) -> Findings:
    """Make a detector, fit it, and ask it of worn and unworn recordings of the medium robot."""
    found = Findings(f"detector {path}")
    detector = found.attempt(lambda: load_detector(path))
    if detector is None:
        return found
    model, cycle = load_model("medium"), "point_to_point"
    try:
        detector.fit([make_batch(model, cycle, 0.0, seed) for seed in (1, 2)], 0, model)
        healthy, worn = (
            [float(detector.test_quantity(make_batch(model, cycle, wear, seed))) for seed in (3, 4, 5)]
            for wear in (0.0, 50.0)
        )
    except (Exception, SystemExit) as error:
        found.add(f"{path}: on a recording of 'medium' it raised {tell_error(error)}; correct the file.")
        return found
    if not np.all(np.isfinite([*healthy, *worn])):
        found.add(
            f"{path}: test_quantity gave {[*healthy, *worn]}; give a finite number for every recording."
        )
    elif min(worn) <= max(healthy):
        found.notes.append(
            f"y does not rise with wear here: {np.mean(healthy):.4g} unworn, {np.mean(worn):.4g} at f = 50."
        )
    else:
        found.notes.append(
            f"y rises with wear: {np.mean(healthy):.4g} unworn, {np.mean(worn):.4g} at f = 50."
        )
    return found


def check_cycle_file(path: str, robots: Sequence[str] = ()) -> Findings:
    """Plan a test-cycle within the limits of given robots, or of the platform's own.

    A test-cycle for one's own robot need not suit the platform's robots: exceeding their limits then gives
    only a note.
    """
    found = Findings(f"test-cycle {path}")
    cycle = found.attempt(lambda: load_cycle(path))
    if cycle is None:
        return found
    lasting = []
    for name in robots or ROBOTS:
        model = found.attempt(lambda name=name: load_model(name))  # type: ignore[misc]
        if model is None:
            continue
        try:
            lasting.append(f"{check_cycle(model, cycle, cycle.name, USUAL, 0.01):.1f} s on {model.name}")
        except InputError as error:
            if not robots and "beyond its limit" in str(error):
                found.notes.append(str(error))
            else:
                found.add(str(error))
    if lasting:
        found.notes.append(f"feasible: {', '.join(lasting)}.")
    return found


def check_effect_file(path: str) -> Findings:
    """Load an effect, which checks its form, and evaluate it along a motion of the medium robot."""
    found = Findings(f"effect {path}")
    effect = found.attempt(lambda: load_effect(path))
    if effect is None or effect.row is None:
        return found
    model = load_model("medium")
    reference = load_cycle("point_to_point").build(model, 0.05, 1.0 / _RATE)
    signals = Signals.along(reference.t, reference.v, reference.q, reference.a, temperature=50.0, wear=10.0)
    columns = effect.columns(signals, 0, effect.pack({})[1])
    if not np.all(np.isfinite(columns)):
        found.add(f"{path}: a regressor of effect '{effect.name}' is not finite along a motion; correct row.")
    elif not np.any(columns):
        found.notes.append(f"all regressors of effect '{effect.name}' are 0 along the motion that was tried.")
    else:
        names = ", ".join(p.name for p in effect.coefficients)
        found.notes.append(f"effect '{effect.name}', estimated from data: {names}.")
    return found


def check_file(path: str | Path, robots: Sequence[str] = ()) -> Findings:
    """Check a Python file by what it defines; its code runs.

    Parameters
    ----------
    path : path-like
    robots : sequence of str
        Robots that a test-cycle is for.

    Raises
    ------
    InputError
        Where it cannot be imported, or defines none of `KINDS`.
    """
    module = plugins.load_file(Path(path), " or ".join(KINDS))
    checks = {
        "DETECTOR": check_detector,
        "CYCLE": lambda one: check_cycle_file(one, robots),
        "EFFECT": check_effect_file,
    }
    for attribute, check in checks.items():
        if hasattr(module, attribute):
            return check(str(path))
    raise InputError(f"{path}: defines no {', '.join(KINDS)}; add one of them.")
