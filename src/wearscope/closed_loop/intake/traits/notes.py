"""Notes on the columns and the machine: what changes no number, and causes that a fit does not separate."""

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.traits.dictionary import scale_payload
from wearscope.closed_loop.intake.traits.hypotheses import NOTE, tell
from wearscope.closed_loop.intake.traits.rows import Rows, subtract_fit
from wearscope.closed_loop.intake.traits.score import PAYLOAD, Model
from wearscope.closed_loop.intake.traits.search import LITTLE, REFUSE, Weighed
from wearscope.effects.torque_constant_error import EFFECT as TORQUE_CONSTANT

#: A torque has no friction where friction makes less than this share of its variance.
NO_FRICTION = 1e-4
#: Least mean gravity torque that counts, over the torque's spread; relative difference within which an offset
#: cancels it; ratio of a torque to what the body needs below which the body does not show.
_WEIGHS, _LACKS, _NO_BODY = 0.5, 0.5, 0.1
#: Largest distance of a payload from the last joint, over the reach; standard errors of an interval.
_AWAY, _SURE = 2.0, 2.0


def add_notes(prepared: Prepared, rows: Rows, found: Weighed) -> None:
    """Add the notes on a data set's columns and machine."""
    loaded = PAYLOAD in found.stated.terms and found.best.reading.traits in ((), ("size",))
    sized = [one for one in (found.best, *found.ties) if loaded and one.reading.traits == ("size",)][:1]
    rivals: list[str] = []
    if sized and sized[0].over(found.stated) < REFUSE:
        # A payload explains the torques about as well as a factor does, and the user can weigh it.
        rivals = [told for some in tell(sized[0].reading, rows) for told, _ in some]
        found = Weighed(found.stated, found.stated, [])
    reading, model = found.best.reading, found.best
    refused, noted = tell(reading, rows)
    names = prepared.dataset.joints
    if found.is_answer:
        # Terms that the machine needs only with the stated reading are rivals of the best reading.
        more = sorted(found.stated.terms - model.terms)
        rival = " or ".join(f"{name} at {names[j]}" if j >= 0 else name for name, j in more)
        also = f"; these motions do not tell it from {rival}." if rival else "."
        other = "; or perhaps ".join(["", *found.list_rivals(rows)])
        prepared.notes += [f"perhaps {told.rstrip('.')}{other}{also}" for told, _ in refused]
    elif found.best.over(found.stated) > NOTE:
        left = f"it leaves up to {100 * np.sqrt(model.held.max()):.0f} % of a torque (RMS)"
        prepared.notes += [f"perhaps, though {left}: {told}" for told, _ in refused]
    if not refused or found.is_answer:
        prepared.notes += [told for told, _ in noted]
        factors = {j: one for j, one in enumerate(reading.size) if one != 1.0}
        prepared.torque_factors = {names[j]: one for j, one in factors.items()}
        # Where all torques are of another size, the masses may be wrong as well.
        if len(factors) < len(names):
            prepared.noted = {(TORQUE_CONSTANT.name, j): one - 1.0 for j, one in factors.items()}
    _note_payload(prepared, found)
    prepared.notes += [f"or, which these motions do not tell from a payload, {told}" for told in rivals]
    for k, j in enumerate(model.fit.joint.tolist()):
        if model.measure_friction(k) < NO_FRICTION and model.left[k] < LITTLE:
            prepared.link_side = prepared.link_side | {names[j]}
    if prepared.link_side:
        link = [name for name in names if name in prepared.link_side]
        prepared.notes.append(
            f"{', '.join(link)}: there is no friction to be seen in this torque, as behind the gear (link "
            'side); "torque: link" in dataset.yaml says so and changes no number.'
        )
    _note_weight(prepared, rows, found.stated)


def _note_weight(prepared: Prepared, rows: Rows, model: Model) -> None:
    """Note torques in which an offset cancels the stated weight, or in which the body hardly shows."""
    fit, still = model.fit, np.zeros_like(rows.q)
    body = prepared.runs[0].signals.rigid_body
    weights = [one.inverse_dynamics(rows.q, still, still) for one in (body, body.with_payload(None))]
    for k, j in enumerate(fit.joint.tolist()):
        at, name = rows.counts[:, j], prepared.dataset.joints[j]
        tau, known = rows.tau[at, j], fit.columns.known[at, j]
        drive = [np.ones(at.sum()), rows.sign[at, j], rows.v[at, j], rows.a[at, j]]
        offset = float(np.linalg.lstsq(np.column_stack(drive), tau - known, rcond=None)[0][0])
        means = np.array([one[at, j].mean() for one in weights])
        heavy = np.abs(means) > _WEIGHS * rows.scale[j]
        lacks = heavy[0] and np.any(heavy & (np.abs(offset + means) < _LACKS * np.abs(means)))
        if lacks and model.left[k] < 5 * LITTLE:
            unit = prepared.dataset.torque_unit[j]
            prepared.notes.append(
                f"{name}: of the weight that the stated bodies have there, {means[0]:.3g} {unit} on average, "
                f"this torque has {means[0] + offset:.3g} {unit}: "
                'gravity was taken out ("torque: without_gravity"), a balancer or '
                "brake carries it, the sensor was set to zero under load, or positions are of another "
                "scale or zero. Where it hardly varies, the data do not tell which; record the drive's whole "
                "torque."
            )
        elif 0.0 < fit.size_alone(k) < _NO_BODY and subtract_fit(known, drive).std() > _WEIGHS * tau.std():
            prepared.notes.append(
                f"{name}: next to nothing of the rigid body is seen in this torque; likely causes: "
                'gravity was taken out ("torque: without_gravity"), a balancer carries the body, positions '
                "are wrong (scale, zero), or masses are far too large."
            )


def _note_payload(prepared: Prepared, found: Weighed) -> None:
    """Note a payload that is not stated: mass with interval, the runs that carry it, and the line to write.

    Where only the place of the weight changes, the link's own weight and the joint's zero explain it as well.
    """
    if PAYLOAD not in found.best.terms:
        return
    rows = found.best.fit.rows
    numbers = np.unique(rows.run[rows.loaded])
    bodies = [prepared.runs[k].signals.rigid_body for k in numbers.tolist()]
    size, reach = scale_payload(bodies[0])
    values, covariance = found.best.find_by_run(found.best.fit.groups[PAYLOAD])
    some = np.isin(np.unique(rows.run), numbers)
    more = (values[some].mean(axis=0) * size)[:4]
    errors = [_SURE * size[k] * float(np.sqrt(covariance[some, k][:, some, k].mean())) for k in range(4)]
    mass, error = float(more[0]), errors[0]
    stated = bodies[0].payload
    whole = more + (np.zeros(4) if stated is None else stated.parameters[:4])
    if np.linalg.norm(more[1:]) > _AWAY * reach * abs(mass) or error > abs(mass):
        if np.any(np.abs(more[1:]) > errors[1:]):
            prepared.notes.append(
                f"{prepared.dataset.joints[-1]}: the last link's weight acts elsewhere than stated. A load "
                "is missing, its centre of mass is off, or its positions have another zero; these torques do "
                "not tell which. State the tool, or compare a recorded position with the robot's pose."
            )
        return
    files = dict.fromkeys(prepared.runs[k].file for k in numbers.tolist())
    where, at = ("", "each run") if rows.loaded.all() else (f" in {', '.join(files)}", "each of them")
    line = f"leave the payload out at {at}"
    if whole[0] > error:
        com = ", ".join(f"{x:.3g}" for x in whole[1:] / whole[0])
        line = f'write "payload: {{mass: {whole[0]:.3g}, com: [{com}]}}" at {at}'
    prepared.notes.append(
        f"a payload about {abs(mass):.3g} kg {'heavier' if mass > 0.0 else 'lighter'} than stated "
        f"({abs(mass) - error:.3g} to {abs(mass) + error:.3g} kg) explains the torques better{where}. "
        f"If that is what the machine carries, {line} in dataset.yaml; otherwise the last link's mass is "
        "off by as much."
    )
