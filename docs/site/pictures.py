"""Pictures of the documentation, drawn from the code when the site is built: each effect, each detector."""

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from wearscope import plugins
from wearscope.cycles.base import Reference, load_cycle
from wearscope.detectors.base import Batch, load_detector
from wearscope.effects.base import Effect, Signals, load_effect
from wearscope.reporting.style import PALETTE, figure_bytes, figure_style, new_figure
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.study import Conditions, simulate_point

#: Parameters that show an effect on a joint of some 100 N m [SI], by effect; others at their defaults.
SHOWN: dict[str, dict[str, float]] = {
    "backlash": {"lost_motion": 2e-3, "mesh_torque": 20.0},
    "concave_viscous": {"level": 20.0},
    "coulomb": {"level": 20.0},
    "coulomb_asymmetry": {"half_difference": 4.0},
    "cross_coupling": {"viscous": 6.0, "coulomb": 8.0, "other": 0.0},
    "friction_temperature": {"eta1": 10.0, "eta2": -0.3, "eta6": -0.2, "eta3": 0.1},
    "gravity_counterbalance": {"sine1": -60.0, "cosine1": 15.0, "pretension": 16.0},
    "inertial_error": {"moment_x_2": 2.0, "moment_y_2": 2.0, "moment_z_2": 2.0},
    "joint_elasticity": {"compliance": 2e-5},
    "joint_spring": {"stiffness": 30.0, "preload": 5.0},
    "load_dependent_friction": {"coefficient": 0.1},
    "payload_error": {"mass": 3.0, "moment_x": 0.3, "moment_z": 0.6},
    "presliding_hysteresis": {"level": 20.0, "displacement": 0.05},
    "quadratic_viscous": {"curvature": 12.0},
    "rotor_inertia": {"inertia": 8.0},
    "rotor_inertia_error": {"inertia": 2.0},
    "stribeck": {"level": 15.0, "speed": 0.1},
    "temperature_dependent_friction": {"coulomb_slope": -0.3, "viscous_slope": -0.2},
    "time_delay": {"delay": 0.01},
    "torque_constant_error": {"gain": 0.05},
    "torque_offset": {"offset": 5.0},
    "torque_ripple": {"cosine": 3.0, "wavenumber": 12.0},
    "unknown": {
        **{f"height{k}": float(8.0 * np.sin(0.9 * k)) for k in range(9)}, "source": 1.0, "low": -1.0,
        "high": 1.0, "knots": 9,
    },
    "viscous": {"slope": 15.0},
    "viscous_asymmetry": {"half_difference": 4.0},
    "warm_up_drift": {"coulomb_drift": -8.0, "viscous_drift": -4.0, "time_constant": 10.0},
    "wear": {"eta7": 0.4, "eta9": 0.15, "eta8": 0.004},
}  # fmt: skip
#: Signal on the horizontal axis, by how what an effect depends on begins; the first that fits.
AXES = (
    ("qdd_", "acceleration [rad/s²]"), ("qd_", "speed [rad/s]"), ("sign_qd_", "speed [rad/s]"),
    ("q_", "position [rad]"), ("{signal}", "position [rad]"), ("load_", "rigid-body torque [N m]"),
)  # fmt: skip
JOINT = 1
STEP = 0.004
TEMPERATURES, WEAR = (30.0, 50.0, 70.0), (0.0, 25.0, 50.0)


def make_pictures() -> dict[str, bytes]:
    """SVG files by their path in the site."""
    found = {
        f"pictures/effects/{name}.svg": draw(partial(draw_effect, name))
        for name in plugins.list_names("effects", "EFFECT")
    }
    answers = ask_detectors()
    for name, lines in answers.items():
        found[f"pictures/detectors/{name}.svg"] = draw(partial(draw_detector, lines))
    return found


def draw(paint: Callable[[Axes], None]) -> bytes:
    """A small figure with one pair of axes."""
    with figure_style():
        figure = new_figure(4.6, 2.6)
        ax = figure.add_subplot()
        paint(ax)
        ax.axhline(0.0, color="#999999", linewidth=0.6, zorder=0)
        if len(ax.get_legend_handles_labels()[0]) > 1:
            ax.legend(fontsize="small")
        return figure_bytes(figure)


def draw_effect(name: str, ax: Axes) -> None:
    """Torque of an effect along two sinusoids, or what it adds to a simulated torque where it has no row."""
    effect = load_effect(name)
    if effect.row is None:
        t, torque = simulate_effect(effect)
        ax.plot(t, torque, color=PALETTE[0])
        ax.set_xlabel("time [s]")
        ax.set_ylabel("torque it adds [N m]" if name != "rigid_body" else "torque [N m]")
        return
    values = {**medium_values(name), **SHOWN.get(name, {})}
    varied = "temp" if any("temp_" in one for one in effect.depends_on) else ""
    worn = any("wear_" in one for one in effect.depends_on)
    label = ("wear {:g}", WEAR) if worn else ("{:g} °C", TEMPERATURES) if varied else ("", (50.0,))
    for colour, level in zip(PALETTE, label[1], strict=False):
        signals = make_signals(level if varied and not worn else 50.0, level if worn else 0.0)
        torque = effect.torque(signals, JOINT, values)
        across, title = choose_axis(effect, signals)
        ax.plot(across, torque, color=colour, linewidth=1.1, label=label[0].format(level))
        ax.set_xlabel(title)
    ax.set_ylabel("torque [N m]")


def medium_values(name: str) -> dict[str, float]:
    """Parameters that the medium robot has at the joint."""
    model = load_model("medium")
    entries = [one for one in model.effects if one.joint == model.joints[JOINT] and one.effect == name]
    return dict(entries[0].parameters) if entries else {}


def make_signals(temperature: float, wear: float) -> Signals:
    """Two joints along sinusoids, the second under a load like gravity's; it rests at neither end."""
    t = np.arange(0.0, 8.0, 0.002)
    turns = np.array([0.31, 0.25])
    q = np.sin(2.0 * np.pi * turns * t[:, None]) * [0.7, 1.0]
    v = np.gradient(q, t, axis=0)
    a = np.gradient(v, t, axis=0)
    load = np.column_stack([30.0 * a[:, 0], 90.0 * np.cos(q[:, 1]) + 20.0 * a[:, 1]])
    return Signals(
        t=t, q=q, v=v, a=a, sign=np.sign(v), load=load, temperature=np.full_like(q, temperature),
        wear=np.full_like(q, wear),
    )  # fmt: skip


def choose_axis(effect: Effect, signals: Signals) -> tuple[np.ndarray, str]:
    """What is drawn across, and its name."""
    if "t" in effect.depends_on or "constant" in effect.depends_on or "qd_{other}" in effect.depends_on:
        return signals.t, "time [s]"
    if effect.n_states:
        return signals.q[:, JOINT], "position [rad]"
    for begin, title in AXES:
        if any(one.startswith(begin) for one in effect.depends_on):
            values = {"acceleration": signals.a, "speed": signals.v, "position": signals.q}
            return values.get(title.split()[0], signals.load)[:, JOINT], title
    return signals.t, "time [s]"


def wave(model: RobotModel) -> Reference:
    """Out and back of all joints from home, from rest to rest without a jump of the acceleration."""
    t = np.arange(0.0, 4.0, STEP)
    share = np.sin(np.pi * t / t[-1]) ** 4
    q = model.home_posture + 0.5 * share[:, None]
    v = np.gradient(q, t, axis=0)
    return Reference(t, q, v, np.gradient(v, t, axis=0))


def simulate_effect(effect: Effect) -> tuple[np.ndarray, np.ndarray]:
    """Time, and what an effect adds to the joint's simulated torque; the torque itself for `rigid_body`."""
    plain = load_model("medium").replace(effects=[])
    joint = plain.joints[JOINT]
    values = SHOWN.get(effect.name, {})
    entry = {"joint": joint, "effect": effect.name, "parameters": values}
    model = plain.replace(effects=[entry] if values else [])
    motion = wave(plain)
    first, second = (simulate_point(one, motion) for one in (plain, model))
    torque = second.tau if effect.name == "rigid_body" else second.tau - first.tau
    return first.t, torque[:, JOINT]


def ask_detectors() -> dict[str, dict[float, tuple[np.ndarray, np.ndarray]]]:
    """Wear and test quantity of each detector by temperature, of the medium robot's second axis."""
    model = load_model("medium")
    reference = load_cycle("axis_sweeps").build(model, 0.05, STEP)

    def record(wear: float, temperature: float, seed: int) -> Batch:
        run = simulate_point(model, reference, Conditions((0.0, wear), temperature), seed)
        return Batch(run.t, run.q, run.qd, run.tau)

    levels = np.linspace(0.0, 50.0, 6)
    nominal = [record(0.0, 50.0, 0)]
    runs = {
        warmth: [record(wear, warmth, 10 * k + j + 1) for j, wear in enumerate(levels)]
        for k, warmth in enumerate(TEMPERATURES)
    }
    answers: dict[str, dict[float, tuple[np.ndarray, np.ndarray]]] = {}
    for name in plugins.list_names("detectors", "DETECTOR"):
        detector = load_detector(name)
        detector.fit(nominal, JOINT, model)
        answers[name] = {
            warmth: (levels, np.array([detector.test_quantity(batch) for batch in batches]))
            for warmth, batches in runs.items()
        }
    return answers


def draw_detector(lines: dict[float, tuple[np.ndarray, np.ndarray]], ax: Axes) -> None:
    """Test quantity over wear, a line a temperature."""
    for colour, (warmth, (wear, y)) in zip(PALETTE, lines.items(), strict=False):
        ax.plot(wear, y, marker="o", markersize=3, linewidth=1.1, color=colour, label=f"{warmth:g} °C")
    ax.set_xlabel("wear of the tested axis [-]")
    ax.set_ylabel("test quantity y")
