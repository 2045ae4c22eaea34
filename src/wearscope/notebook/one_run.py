"""The function `simulate`: one simulated run as a data frame."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from wearscope.cycles.base import load_cycle
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.recording import join_units
from wearscope.simulation.study import Conditions, simulate_point


def simulate(
    robot: str | RobotModel,
    cycle: str,
    *,
    wear: float | Sequence[float] = 0.0,
    temperature: float = 50.0,
    payload_mass_error: float = 0.0,
    dwell: float = 0.05,
    step: float = 0.001,
    sample_rate: float | None = None,
    seed: int | None = None,
) -> pd.DataFrame:
    """Simulate one test-cycle of a robot, and record it as its drive would.

    Parameters
    ----------
    robot : str or RobotModel
        A name in the platform's robots, or the path of a model.
    cycle : str
        A name in the platform's test-cycles, or the path of a ``.py`` file that defines ``CYCLE``.
    wear : float or sequence of float
        Wear index f of eq. (17) of Samuelsson et al. (2014) [-], of all wearing joints or of each in turn.
    temperature : float
        Temperature of all joints [deg C].
    payload_mass_error : float
        Error of the declared payload mass relative to the true mass [-].
    dwell : float
        Pause before each next move [s], the paper's w4.
    step : float
        Time step [s].
    sample_rate : float, optional
        Sample rate of the recording [Hz]; by default that of the robot's sensors.
    seed : int, optional
        Seed of the sensors' noise; by default there is no noise.

    Returns
    -------
    DataFrame
        Long form, joint after joint: ``t`` [s], ``joint``, ``q``, ``qd``, ``tau``. ``attrs["units"]`` has the
        units; where joints differ, the unit lists them by joint.

    Raises
    ------
    InputError
        Where robot, test-cycle or conditions do not fit together.
    SimulationError
        Where the run fails.

    Examples
    --------
    >>> from wearscope import simulate
    >>> new, worn = (simulate("medium", "axis_sweeps", wear=f, seed=1) for f in (0.0, 50.0))
    >>> moving = new.qd.abs() > 0.1
    >>> bool(worn.tau[moving].abs().mean() > new.tau[moving].abs().mean())
    True
    """
    model = robot if isinstance(robot, RobotModel) else load_model(robot)
    levels = np.full(len(model.wear_joints), wear) if np.ndim(wear) == 0 else np.asarray(wear, dtype=float)
    conditions = Conditions(tuple(levels.tolist()), temperature, payload_mass_error)
    reference = load_cycle(cycle).build(model, dwell, step)
    recording = simulate_point(model, reference, conditions, seed, sample_rate)
    count, n = recording.q.shape
    frame = pd.DataFrame(
        {
            "t": np.tile(recording.t, n),
            "joint": np.repeat(model.joints, count),
            "q": recording.q.T.ravel(),
            "qd": recording.qd.T.ravel(),
            "tau": recording.tau.T.ravel(),
        }
    )
    position, torque = list(model.position_units), list(model.torque_units)
    frame.attrs["units"] = {
        "t": "s",
        "q": join_units(model.joints, position),
        "qd": join_units(model.joints, [f"{unit}/s" for unit in position]),
        "tau": join_units(model.joints, torque),
    }
    return frame
