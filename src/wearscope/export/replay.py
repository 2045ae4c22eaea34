"""How far each format's replay of a motion is from the model that was exported.

MuJoCo gets the torque that the motion needs of the whole model, and starts anew on the motion every so often;
its position after 0.1, 0.5 and 2 s is compared with the motion. Nothing feeds an error back.
"""

from typing import Any

import mujoco
import numpy as np

from wearscope.cycles.base import Reference
from wearscope.export.comparison import inverse_dynamics, link_motion, whole_torque
from wearscope.export.formats import make_spec
from wearscope.export.gears import find_gears, place_gears
from wearscope.export.holdings import FORMATS, MJCF, Holdings, held_by, without_motors
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array

#: Times after which the position is compared [s], and between two starts; time for bristles and gears to
#: follow.
HORIZONS, _EVERY, _WARM = (0.1, 0.5, 2.0), 0.5, 0.3
#: MuJoCo's step [s].
STEP = 1e-3
WITHOUT = f"{MJCF} without passive motors"


def compare_replays(
    model: RobotModel, held: Holdings, reference: Reference, temperature: float
) -> dict[str, dict[str, Any]]:
    """Differences of each format's replay, by format and joint, of what `comparison.compare` takes.

    Returns
    -------
    dict
        By format, and for MJCF without its passive motors, by joint: `torque`, RMS difference along the
        motion [N m or N], and `position`, median absolute difference by time [rad or m].
    """
    whole = whole_torque(model, held, reference, temperature)
    links = link_motion(model, held, reference)
    formats = {format: held_by(held, format) for format in FORMATS} | {WITHOUT: without_motors(held)}
    found: dict[str, dict[str, Any]] = {}
    for format, one in formats.items():
        spec = make_spec(model, one)
        own = inverse_dynamics(spec, model.joints, reference, links=links)
        torque = np.sqrt(np.mean((own - whole) ** 2, axis=0))
        position = replay(spec, model.joints, reference, whole, links)
        found[format] = {
            joint: {
                "torque": float(torque[j]),
                "position": {f"{s:g}": float(position[k, j]) for k, s in enumerate(HORIZONS)},
            }
            for j, joint in enumerate(model.joints)
        }
    return found


def replay(
    spec: mujoco.MjSpec,
    joints: list[str],
    reference: Reference,
    torque: Array,
    links: Reference | None = None,
) -> Array:
    """Median position error (3, n) after each of `HORIZONS` under a torque (N, n) along a motion.

    Where the model has gears, they begin where the motion of the `links` has them.
    """
    model = spec.compile()
    model.opt.timestep = STEP
    data = mujoco.MjData(model)
    q = [int(model.joint(name).qposadr[0]) for name in joints]
    v = [int(model.joint(name).dofadr[0]) for name in joints]
    t = np.arange(reference.t[0], reference.t[-1], STEP)
    gears, behind = find_gears(model, joints), links or reference
    place, speed, drive, lag, slip = (
        np.column_stack([np.interp(t, reference.t, column) for column in x.T])
        for x in (reference.q, reference.v, torque, behind.q - reference.q, behind.v - reference.v)
    )
    ends = [round(one / STEP) for one in HORIZONS]
    warm = round(_WARM / STEP)
    errors = []
    for start in range(warm, len(t) - ends[-1], round(_EVERY / STEP)):
        mujoco.mj_resetData(model, data)
        place_gears(data, gears, (lag[start - warm], slip[start - warm], 0.0 * slip[0]))
        for row in range(start - warm, start):
            data.qpos[q], data.qvel[v], data.qfrc_applied[v] = place[row], speed[row], drive[row]
            mujoco.mj_step(model, data)
        data.qpos[q], data.qvel[v] = place[start], speed[start]
        reached = []
        for row in range(start, start + ends[-1]):
            data.qfrc_applied[v] = drive[row]
            mujoco.mj_step(model, data)
            if row + 1 - start in ends:
                reached.append(np.abs(data.qpos[q] - place[row + 1]))
        data.qfrc_applied[v] = 0.0
        errors.append(reached)
    return np.asarray(np.median(np.array(errors), axis=0))
