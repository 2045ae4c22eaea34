"""Pictures of the page on the torque column: one joint along one motion, as recorders write it."""

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from pictures import draw

from wearscope.reporting.style import PALETTE

#: Inertia of link and rotor [kg m^2], weight times arm [N m], Coulomb [N m], viscous [N m s/rad].
LINK, ROTOR, WEIGHT, COULOMB, VISCOUS = 4.0, 3.0, 30.0, 12.0, 6.0
#: Joint torque by ampere, of a motor of 0.11 N m/A behind a gear of 100 [N m/A].
BY_AMPERE = 11.0
#: Delay that is drawn [s].
DELAY = 0.15


def move(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, speed and acceleration of a motion of two frequencies."""
    rates, sizes = 2.0 * np.pi * np.array([0.25, 0.6]), np.array([0.9, 0.25])
    angle = np.outer(t, rates)
    return np.sin(angle) @ sizes, np.cos(angle) @ (sizes * rates), -np.sin(angle) @ (sizes * rates**2)


def drive_torque(t: np.ndarray) -> np.ndarray:
    """Torque that the drive exerts, joint side [N m]."""
    q, v, a = move(t)
    return (LINK + ROTOR) * a + WEIGHT * np.cos(q) + COULOMB * np.tanh(v / 0.02) + VISCOUS * v


def record(reading: str, t: np.ndarray) -> np.ndarray:
    """What a recorder writes, by the reading that holds."""
    q, _, a = move(t)
    noise = np.random.default_rng(0).normal(0.0, 0.6, t.shape)
    torque = drive_torque(t)
    if reading == "link":
        torque = LINK * a + WEIGHT * np.cos(q)
    elif reading == "without_gravity":
        torque = torque - WEIGHT * np.cos(q)
    elif reading == "none":
        torque = 3.0 + 2.0 * np.cumsum(np.random.default_rng(1).normal(0.0, 0.1, t.shape))
    elif reading == "sign":
        torque = -torque
    elif reading == "current":
        torque = torque / BY_AMPERE
    elif reading == "delay":
        torque = drive_torque(t - DELAY)
    return torque + noise * (0.1 if reading == "current" else 1.0)


READINGS = ("motor", "link", "without_gravity", "none", "sign", "current", "delay")


def draw_reading(reading: str, ax: Axes) -> None:
    """Recorded column over time, and the drive's torque behind it."""
    t = np.linspace(0.0, 8.0, 800)
    ax.plot(t, drive_torque(t), color="#aaaaaa", linewidth=2.2, label="drive torque")
    ax.plot(t, record(reading, t), color=PALETTE[0], linewidth=1.0, label="column")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("torque [N m]" if reading != "current" else "torque [N m], column [A]")


def make_pictures() -> dict[str, bytes]:
    """SVG files by their path in the site."""
    return {f"pictures/torque/{one}.svg": draw(partial(draw_reading, one)) for one in READINGS}
