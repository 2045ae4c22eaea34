"""What a machine may physically have of each effect, so that no plant is larger than life."""

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.board.physics import Active, Structural
from benchmarks.board.terms import Term

if TYPE_CHECKING:
    from benchmarks.board.generate import Recording

ARC_MINUTE = np.pi / 180 / 60
LOST_MOTION = {False: 10 * ARC_MINUTE, True: 1e-4}
"""Largest lost motion of a gear [rad], and of a spindle [m]."""
STRETCH = {False: 10 * ARC_MINUTE, True: 1e-4}
"""Largest RMS deflection of a joint under its load [rad or m]."""
GAIN, DELAY, SHORTEST_DELAY = 0.12, 0.012, 0.2
"""Largest error of a drive's gain; longest delay [s]; shortest delay in samples."""
LOSS = 0.4
"""Largest friction of a gear over its load: more does not drive back."""
MASS, PAYLOAD = 0.3, 0.5
"""Largest relative error of a link's mass, and of the payload's."""
SHARES = {
    "gravity_counterbalance": 1.0,
    "joint_spring": 0.5,
    "torque_ripple": 0.3,
    "rotor_inertia_error": 0.3,
    "torque_offset": 0.4,
}
SHARE = 0.4
"""Largest RMS of any other effect over that of the joint's torque."""


def limit_amplitude(recording: "Recording", plant: Term | Structural, effect: str, amplitude: float) -> float:
    """Amplitude within what the machine may have.

    Parameters
    ----------
    recording : Recording
    plant : Term or Structural
    effect : str
    amplitude : float
        The one wanted.
    """
    machine, j = recording.setting.machine, plant.joint
    size, sign = abs(amplitude), float(np.sign(amplitude))
    most, least = np.inf, 0.0
    slides = machine.prismatic[j]
    if effect == "backlash":
        most = LOST_MOTION[slides]
    elif effect == "joint_elasticity":
        load = np.concatenate([recording.loads[k][:, j] for k in recording.pick_training()])
        most = STRETCH[slides] / float(np.sqrt(np.mean(load**2)) + 1e-300)
    elif effect == "torque_constant_error":
        most = GAIN
    elif effect == "time_delay":
        most, least = DELAY, SHORTEST_DELAY / recording.recipe.rate
    elif effect == "load_dependent_friction":
        most = LOSS
    elif effect == "payload_error":
        most = PAYLOAD * machine.payload_mass
    elif effect == "inertial_error":
        most = MASS
    else:
        quiet = np.concatenate([recording.behave(k, []).tau[:, j] for k in recording.pick_training()])
        torque = np.vstack(recording.plant_torque(Active(plant, amplitude)))[:, j]
        share = np.sqrt(np.mean(torque**2)) / np.sqrt(np.mean(quiet**2) + 1e-300)
        most = size * SHARES.get(effect, SHARE) / float(share + 1e-300)
    return sign * float(max(min(size, most), least))
