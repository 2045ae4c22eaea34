"""Adds to every planted entry its measured size, its just findable size and whether it can be told apart."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from benchmarks.board.features import KEPT_RATE_HZ, Families, Track, make_track
from benchmarks.board.truth import ONE_COEFFICIENT, JointView

if TYPE_CHECKING:
    from benchmarks.board.generate import Recording

Array = NDArray[np.float64]

STANDARD = ("rigid_body", "rotor_inertia", "coulomb", "viscous", "torque_offset")
"""Only these are rivals of a standard effect: richer forms come after their simple parents."""
NOTICED = 0.5
"""An effect on several joints concerns those where it is this much of the noise RMS."""
SPREAD = 0.2
"""Standard deviation of approximate inertials over their size, as the refit takes it."""
MEMORIES = {"drift": 1.0, "hum": 0.25, "harmonics": 0.25, "event": 0.3}
"""Time over which noise is autocorrelated, by kind [s]; coloured noise has its own, the rest none."""


def _inertial_columns(recording: "Recording", tracks: list[Track]) -> Array:
    """Regressors (rows, n, 10 n) of the links' inertial parameters at the kept rows of the training runs.

    The motions hold nothing above the common band, so that they need no smoothing.
    """
    model, data = recording.body.model, recording.body.data
    thin = max(1, round(recording.recipe.rate / KEPT_RATE_HZ))
    rows = []
    for track in tracks:
        for i in range(thin, len(track.t) - thin, thin):
            regressor = pin.computeJointTorqueRegressor(model, data, track.q[i], track.v[i], track.a[i])
            rows.append(regressor.reshape(len(track.q[i]), -1).copy())
    return np.array(rows)


def _inertial_spread(recording: "Recording") -> Array:
    """How far (10 n,) the inertial parameters may be off, as a standard deviation: `SPREAD` of their size.

    A small one of a group (mass, first moments, inertias of a link) counts as half of the group's largest.
    """
    spreads = []
    for link in list(recording.body.model.inertias)[1:]:
        parameters = np.abs(link.toDynamicParameters())
        for group in (slice(0, 1), slice(1, 4), slice(4, 10)):
            values = parameters[group]
            spreads.append(SPREAD * np.maximum(values, max(0.5 * float(values.max()), 1e-6)))
    return np.concatenate(spreads)


def assess_entries(
    entries: list[dict[str, Any]], torques: list[list[Array]], recording: "Recording", declared: list[str],
    separations: list[Array], with_temperature: bool,
) -> None:  # fmt: skip
    """Add to every entry, in place, what its plant is worth and whether it can be found and told apart.

    `measured_size`, `unabsorbed_size`, `findable_size`, `times_findable`, `separable`, `rivals`; see `truth`.

    Parameters
    ----------
    entries : list of dict
        As `generate` describes them.
    torques : list of list of array (N, n)
        Torque of each entry alone, by training run, at the recorded rate.
    recording : Recording
    declared : list of str
    separations : list of array (N, n)
        What separates the record from the true model along the measured motion, by training run.
    with_temperature : bool
    """
    if not entries:
        return
    recipe, machine, sigma = recording.recipe, recording.setting.machine, recording.sigma
    every = slice(None, None, recipe.oversampling)
    training = recording.pick_training()
    tracks = []
    for number in training:
        motion, load = recording.motions[number], recording.loads[number]
        warm = recording.temperatures[number][every] if with_temperature else None
        tracks.append(
            make_track(
                recording.body, machine.urdf, motion.t[every], motion.q[every], motion.v[every],
                motion.a[every], warm, machine.payload_mass > 0, load[every],
            )
        )  # fmt: skip
    approximate = bool(recipe.inertia_error) if recipe.approximate is None else recipe.approximate
    inertial = _inertial_columns(recording, tracks) if approximate else None
    spread = _inertial_spread(recording)
    refitted = ["rotor_inertia_given" if x == "rotor_inertia" and recipe.rotor_given else x for x in declared]
    memory = recipe.memory if recipe.noise == "coloured" else MEMORIES.get(recipe.noise, 0.0)
    views: dict[int, JointView] = {}

    def view(j: int) -> JointView:
        if j not in views:
            families = Families(tracks, j, recipe.rate, machine.prismatic[j], refitted)
            orders = [
                entry["parameters"]["order"]["value"]
                for entry in entries
                if "order" in entry["parameters"] and entry["joint"] == machine.joints[j]
            ]
            families.ripple_orders = (*families.ripple_orders, *orders)
            noise = [separation[:, j] for separation in separations]
            extra = None if inertial is None else (inertial[:, j], spread)
            views[j] = JointView(families, noise, memory, len(machine.joints), extra)
        return views[j]

    for entry, torque in zip(entries, torques, strict=True):
        ratio = np.sqrt(np.mean(np.vstack(torque) ** 2, axis=0)) / sigma
        concerned = [machine.joints.index(entry["joint"])]
        if len(entry["joints"]) > 1:
            concerned = [j for j in range(len(machine.joints)) if ratio[j] >= NOTICED]
            concerned = concerned or [int(np.argmax(ratio))]
        judged = {}
        for j in concerned:
            others = [
                [x[:, j] for x in other]
                for that, other in zip(entries, torques, strict=True)
                if that is not entry and max(np.abs(x[:, j]).max() for x in other) > 1e-9 * sigma[j]
            ]
            judged[j] = view(j).judge(
                entry["effect"], [x[:, j] for x in torque], others, STANDARD if entry["standard"] else None
            )
        best = min(judged, key=lambda j: judged[j]["findable"])
        found = judged[best]
        rivals = dict(found["rivals"])
        for other_joint in judged.values():
            rivals = {name: margin for name, margin in rivals.items() if name in other_joint["rivals"]}
        if found["nearest"] is not None:
            main = entry["parameters"].get(ONE_COEFFICIENT[entry["effect"]])
            if main is not None:
                main["nearest"] = found["nearest"]
        if len(entry["joints"]) > 1:
            entry["joint"] = machine.joints[best]
        entry["measured_size"] = float(ratio[best])
        entry["unabsorbed_size"] = found["unabsorbed"] / float(sigma[best])
        entry["findable_size"] = found["findable"] * entry["measured_size"]
        entry["times_findable"] = 1.0 / found["findable"]
        entry["rivals"] = rivals
        entry["separable"] = bool(not rivals and np.isfinite(found["findable"]))
