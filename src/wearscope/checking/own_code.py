"""Checks a user's Python file with a detector, test-cycle or effect by a trial on built-in robots."""

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

#: Kind of plug-in, by the name that its file defines.
KINDS = {"DETECTOR": "detector", "CYCLE": "test-cycle", "EFFECT": "effect"}
#: Robots on which a test-cycle is tried.
ROBOTS = ("medium", "large")
#: Sample rate of the trial recordings [Hz].
_RATE = 250.0


def make_batch(model: RobotModel, cycle: str, wear: float, seed: int, temperature: float = 50.0) -> Batch:
    """Make a recording of a test-cycle by inverse dynamics, without simulation.

    The motion is the reference motion. The torque is the one that the model needs for it, plus the model's
    sensor noise.

    Parameters
    ----------
    model : RobotModel
    cycle : str
        Test-cycle, by name or path, see `wearscope.cycles.base.load_cycle`.
    wear : float
        Wear level f of all wearing joints [-].
    seed : int
        Seed of the noise.
    temperature : float
        Joint temperature [deg C].
    """
    reference = load_cycle(cycle).build(model, 0.05, 1.0 / _RATE)
    torque = required_torque(reference, model, temperature, wear, 1.0)
    noise = np.random.default_rng(seed).normal(size=torque.shape) * model.torque_noise
    return Batch(reference.t, reference.q, reference.v, torque + noise, _RATE)


def check_detector(path: str) -> Findings:
    """Check that a detector gives finite test quantities, and report whether they rise with wear.

    It is fitted and tried on recordings of the medium robot, with f = 0 and f = 50.
    """
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
    """Check that a test-cycle keeps to the limits of the given robots, by default of built-in ones.

    A test-cycle for a user's robot need not suit built-in robots, so exceeding the limits of these gives
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
    """Load an effect, which checks its definition, and evaluate its regressors along a motion of a robot."""
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
    """Import a Python file and check the detector, test-cycle or effect that it defines.

    Parameters
    ----------
    path : path-like
    robots : sequence of str
        Robots that a test-cycle is meant for.

    Raises
    ------
    InputError
        If the file cannot be imported, or defines none of `KINDS`.
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
