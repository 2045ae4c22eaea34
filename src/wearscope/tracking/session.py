"""Comparison of one session with the reference: what changed in it, and what the session does not show.

A change may be a body that was added to a link or taken from it. Its mass and place are then estimated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.events import Event, find_events, leave_out
from wearscope.robots.spatial import Inertia
from wearscope.tracking.changes import BODY, FRICTION, Change
from wearscope.tracking.evidence import FALSE_ALARM_RATE, Evidence, Fit, invert
from wearscope.tracking.reference import Reference, leave_changes
from wearscope.tracking.rows import hold_temperatures, make_rows
from wearscope.tracking.search import CHANCE, Found, find_changes
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import prepare_runs, read_session
from wearscope.tracking.structure import Structure
from wearscope.tracking.worn import Worn, identify_wear

#: Standard errors of a 95 % interval.
WIDTH = 2.0
#: A temperature counts as within the reference's range up to this many kelvin beyond it.
_BEYOND = 1.0
#: Temperature hides a joint's friction where only changes above the first share would show, while changes
#: below the second share would show if the influence of the temperature were known.
_HIDDEN, _SEEN = 0.3, 0.15


@dataclass(frozen=True)
class Assessment:
    """Changes that a session shows, and what it cannot show.

    Attributes
    ----------
    session : str
    named : list of Change
    fit : Fit
        Fit of the named changes.
    found : Found
        Result of the search, with the alternatives.
    evidence : Evidence
    felt : Evidence
        Evidence with all temperatures held within the reference's, so that friction includes the influence
        of other temperatures.
    cannot_tell : list of str
        Sentences on what the session cannot show.
    smallest : dict of str to dict
        By joint, the smallest change that the session would show: `friction` as a share of it, and `mass`
        [kg] on the link that the joint moves, at its centre of mass.
    notes : list of str
    worn : list of Worn
        Wear of each joint whose friction grew.
    events : list of dict
        Short events, as ``verdict.json`` has them; their rows are left out.
    """

    session: str
    named: list[Change]
    fit: Fit
    found: Found
    evidence: Evidence
    felt: Evidence
    cannot_tell: list[str]
    smallest: dict[str, dict[str, float]]
    notes: list[str]
    worn: list[Worn]
    events: list[Event] = field(default_factory=list)


def assess_session(
    sessions: Sessions, session: str, reference: Reference, level: float = FALSE_ALARM_RATE
) -> Assessment:
    """Read a session and find what changed since the reference.

    Raises
    ------
    InputError
        Where its runs break the format, or a channel is broken beyond correction.
    """
    runs, notes = prepare_runs(read_session(sessions, session), reference.structure.frame)
    return assess_runs(session, runs, reference, notes, level)


def assess_runs(
    session: str, runs: Sequence[PreparedRun], reference: Reference, notes: Sequence[str] = (),
    level: float = FALSE_ALARM_RATE,
) -> Assessment:  # fmt: skip
    """Find what changed in a session's runs, which were prepared with the reference's `Frame`."""
    structure = reference.structure
    events = find_session_events(reference, runs)
    runs = leave_out(runs, events, structure.joints)
    made = [make_rows(structure, run) for run in runs]
    evidence = reference.weigh(made, level)
    known = evidence
    if is_temperature_open(structure, runs):
        held = [make_rows(structure, hold_temperatures(structure, run)) for run in runs]
        known = reference.weigh(held, level, of_temperature=False)
    found = find_changes(known, reference.usual, reference.reach)
    named, hidden = list(found.named), {}
    if known is not evidence:
        evidence.weigh(known.variance)
        for change in [c for c in named if c.kind == FRICTION]:
            rest, with_it = [c for c in named if c is not change], evidence.fit(named)
            if with_it.p_value(change) > CHANCE or evidence.compare(evidence.fit(rest), with_it) < 0.0:
                named, hidden[change.joint] = rest, tell_size(known, found.fit, change)
    cannot_tell = [
        f"The friction of {structure.joints[j]} changed by {size}, by wear or by its temperature: "
        f"{describe_temperatures(structure, runs, j)}"
        for j, size in hidden.items()
    ]
    smallest = find_smallest(known, found.fit.changes, reference)
    blind = find_smallest(evidence, found.fit.changes, reference)
    for j in structure.moving:
        joint = structure.joints[j]
        sees, saw = (one[joint].get(FRICTION, np.inf) for one in (blind, smallest))
        if j not in hidden and sees > _HIDDEN and saw < _SEEN and _is_recorded(runs, j):
            size = f" by less than {100 * sees:.0f} %" if np.isfinite(sees) else ""
            cannot_tell.append(
                f"A change of {joint}'s friction{size} could not be seen: "
                f"{describe_temperatures(structure, runs, j)}"
            )
    cannot_tell += tell_unknown(found, structure)
    fit = evidence.fit(named)
    worn = identify_wear(reference, made, named)
    told = [*notes, *tell_events(events, dict(zip(structure.joints, structure.torque_unit, strict=True)))]
    return Assessment(session, named, fit, found, evidence, known, cannot_tell, smallest, told, worn, events)


def is_temperature_open(structure: Structure, runs: Sequence[PreparedRun]) -> bool:
    """Whether a moving joint's temperature is unknown, or outside of the reference's range."""
    for j in structure.moving:
        warmth = np.concatenate([run.signals.temperature[:, j] for run in runs])
        low, high = structure.warmth[:, j] + np.array([-_BEYOND, _BEYOND])
        if not np.all((warmth >= low) & (warmth <= high)):
            return True
    return False


def tell_size(evidence: Evidence, fit: Fit, change: Change) -> str:
    """Words for a change of a joint's friction in per cent, with its 95 % interval."""
    share, error = measure_share(evidence, fit, change)
    ends = [100 * (share - WIDTH * error), 100 * (share + WIDTH * error)]
    said = f"{100 * share:+.0f} % ({ends[0]:+.0f} to {ends[1]:+.0f} %)"
    return said.replace("-", chr(0x2212))


def measure_share(evidence: Evidence, fit: Fit, change: Change) -> tuple[float, float]:
    """Signed RMS torque of a change as a share of its joint's friction or torque, and its standard error.

    It is positive where the change dissipates power along the motion. Noise makes any RMS larger; its part is
    subtracted.
    """
    structure, j = evidence.structure, change.joint
    friction = any(term.effect.is_friction for term in change.terms)
    size = structure.scales.friction[j] if friction else structure.scales.torque[j]
    z = evidence.z[:, :, evidence.at[change.key]]
    at = int(np.argmax(((z @ fit.values[change.key]) ** 2).sum(axis=0))) if change.kind == BODY else j
    x = z[:, at] / size / np.sqrt(evidence.count[at])
    value, covariance = fit.values[change.key], fit.covariances[change.key]
    square = x.T @ x
    rms = np.sqrt(max(float(value @ square @ value), 1e-300))
    slope = square @ value / rms
    error = float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))
    sign = np.sign(np.sqrt(np.diag(square)) @ value) or 1.0
    return float(sign * np.sqrt(max(rms**2 - float(np.sum(square * covariance)), 0.0))), error


def find_smallest(
    evidence: Evidence, changes: Sequence[Change], reference: Reference
) -> dict[str, dict[str, float]]:
    """By joint, the smallest change of friction (as a share) and mass [kg] on its link that would show.

    It comes in addition to the changes that the session shows.
    """
    structure, fit, found = reference.structure, evidence.fit(changes), {}
    for j, joint in enumerate(structure.joints):
        seen = {}
        whole = next((c for c in evidence.changes if c.kind == FRICTION and c.joint == j), None)
        if whole is not None:
            x = evidence.z[:, j, evidence.at[whole.key]].sum(axis=1)
            share = np.sqrt((x @ x) / evidence.count[j]) / structure.scales.friction[j]
            seen[FRICTION] = float(share * evidence.smallest(fit, whole, np.ones(whole.count)))
        body = next(c for c in evidence.changes if c.kind == BODY and c.joint == j)
        seen["mass"] = evidence.smallest(fit, body, np.array([1.0, *reference.centres[j]]))
        found[joint] = {name: size for name, size in seen.items() if np.isfinite(size)}
    return found


def tell_unknown(found: Found, structure: Structure) -> list[str]:
    """Sentences on changes that cancel, and on joints that no change explains."""
    said = []
    for pair in found.cancelling:
        joint = structure.joints[max(change.joint for change in pair)]
        names = " and ".join(" and ".join(change.effects).replace("_", " ") for change in pair)
        said.append(
            f"{joint}: {names} take each other back and are not told apart. Record motions at several "
            "speeds, over more of the joint's range, with and without a known payload."
        )
    for j, ratio in found.unexplained.items():
        said.append(
            f"{structure.joints[j]}: torque that no change explains, {np.sqrt(ratio):.1f} times what healthy "
            "sessions leave (RMS), such as forces from outside, play, a loose belt or a shifted encoder. "
            "It may also come from a motion unlike those of the healthy sessions. Record the session again "
            "without contact, with a motion of theirs; if it stays, examine the joint."
        )
    return said


def find_session_events(reference: Reference, runs: Sequence[PreparedRun]) -> list[Event]:
    """Short events in the residual of all changes, judged by the noise and tail of healthy sessions."""
    structure = reference.structure
    left = leave_changes(reference.weigh([make_rows(structure, run) for run in runs]), runs)
    frame = structure.frame
    return find_events(runs, left, structure.joints, frame.moving, frame.top_speed, healthy=reference.tails)


def tell_events(events: Sequence[Event], units: dict[str, str]) -> list[str]:
    """A sentence on each event."""
    return [
        f"{e['run']}: {e['joint']}: torque that the model does not have at t = {e['t']:.2f} s for "
        f"{e['seconds']:.2f} s, up to {e['size']:.3g} {units[e['joint']]}; an event, its rows are left out."
        for e in events
    ]


def _is_recorded(runs: Sequence[PreparedRun], joint: int) -> bool:
    return all(bool(np.isfinite(run.signals.temperature[:, joint]).all()) for run in runs)


def describe_temperatures(structure: Structure, runs: Sequence[PreparedRun], joint: int) -> str:
    """Why a session's temperature may explain a change of friction, and what to measure."""
    name = structure.joints[joint]
    if not np.isfinite(structure.temperature[joint]):
        return (
            f"the reference records no temp_{name}. Record it in healthy sessions at several temperatures, "
            "and in later ones."
        )
    if not _is_recorded(runs, joint):
        return f"this session records no temp_{name}. Record it."
    warmth = np.concatenate([run.signals.temperature[:, joint] for run in runs])
    low, high = structure.warmth[:, joint]
    seen = f"it ran at {warmth.min():.0f} to {warmth.max():.0f} °C, the reference at {low:.0f} to {high:.0f}."
    if warmth.max() > high + _BEYOND or warmth.min() < low - _BEYOND:
        return (
            f"{seen} Measure healthy sessions that reach these temperatures, or this one at the reference's."
        )
    return f"{seen} Those show too little of what temperature does; measure more healthy sessions."


def list_entries(assessment: Assessment, reference: Reference) -> list[dict[str, Any]]:
    """Entries of `tracking.json` for the changes of a session, one per parameter, without `since`.

    A parameter whose interval holds zero is left out if another parameter of the same change is significant.
    A body is described by its mass in kg, as a point, and by its moments.
    """
    structure, entries = reference.structure, []
    for change in assessment.named:
        value, error = change.spread_over(assessment.fit.values[change.key], assessment.fit.error(change))
        units = structure.position_unit[change.joint], structure.torque_unit[change.joint]
        alike = assessment.found.alike.get(change.key, [])
        same = [other for other in alike if other.kind == change.kind == BODY]
        names = dict.fromkeys(name for other in alike if other not in same for name in other.effects)
        rest = {
            "equivalent": [name for name in names if name not in change.effects],
            "anywhere": list(dict.fromkeys(structure.joints[other.joint] for other in same)),
            "key": f"{change.effects[0] if change.kind == BODY else change.name}@{change.joint}",
        }
        sure = np.abs(value) > WIDTH * error
        for (effect, parameter), x, half, is_sure in zip(
            change.parameters, value, WIDTH * error, sure, strict=True
        ):
            ends = [float(x - half), float(x + half)]
            if change.kind == BODY and parameter.name == "mass":
                mass, low, high = weigh_change(assessment, reference, change)
                x, ends, is_sure = mass, [low, high], True
            if effect.is_thermal or (not is_sure and sure.any()):
                continue
            entries.append(
                {
                    "joint": structure.joints[change.joint],
                    "effect": effect.name,
                    "parameter": parameter.name,
                    "change": float(x),
                    "ci95": ends,
                    "unit": parameter.unit_at(*units),
                    **rest,
                }
            )
    return entries


def weigh_change(assessment: Assessment, reference: Reference, change: Change) -> tuple[float, float, float]:
    """Mass [kg] of a body on a link and its 95 % interval, from a fit with its inertia."""
    evidence = assessment.evidence
    whole = max(
        (c for c in evidence.changes if c.kind == BODY and c.joint == change.joint), key=lambda c: c.count
    )
    fit = evidence.fit([whole if c is change else c for c in assessment.named])
    return weigh_point(
        fit.values[whole.key], fit.covariances[whole.key], reference.payload_prior, reference.reach
    )[:3]


#: Largest mass that is tried, as a multiple of the least one that its moment allows; steps per decade.
_MOST, _STEPS = 1e3, 24
#: Usual radius of a body about its own centre, as a share of the arm's reach.
_OWN = 0.05
#: Usual mass of a body, as a multiple of the prior standard deviation of a link's mass.
_HEAVY = 3.0
#: Rise of the misfit (chi-square) at the ends of a 95 % interval of one parameter.
_RISE = 3.84


def point_parameters(mass: float, place: np.ndarray, radius: float = 0.0) -> np.ndarray:
    """Inertial parameters (10,) of a round body, as the regressor of a rigid body orders them.

    `radius` is that of gyration about its own centre.
    """
    return Inertia(mass, place, mass * radius**2 * np.eye(3)).to_parameters()


def weigh_point(
    value: np.ndarray, covariance: np.ndarray, prior: np.ndarray, reach: float
) -> tuple[float, float, float, np.ndarray]:
    """Mass of a body with its 95 % interval, and its place.

    The interval is that of the profile likelihood: for each mass, the place and the body's own radius are
    fitted, the place within about the arm's reach, the radius within a share of it.

    Parameters
    ----------
    value, covariance : ndarray (10,), (10, 10)
        Inertial parameters of a body that was fitted with the prior.
    prior : ndarray (10,)
        Prior precision of that fit, which is taken out again.
    reach : float
        Reach of the arm [m].

    Returns
    -------
    mass, low, high : float
        [kg]; negative where a body was taken away.
    place : ndarray (3,)
        In the link's frame [m].
    """
    precision = invert(covariance)
    goal = precision @ value
    size, vector = np.linalg.eigh(precision - np.diag(prior))
    keep = size > 1e-6 * size.max()
    root = np.sqrt(size[keep])[:, None] * vector[:, keep].T
    wanted = (vector[:, keep].T @ goal) / np.sqrt(size[keep])
    moment = float(np.linalg.norm(value[1:4]))
    least = max(moment / reach, 0.02 * abs(value[0]), 1e-9)
    masses = least * np.geomspace(0.5, _MOST, int(_STEPS * np.log10(2.0 * _MOST)))
    # A usual body weighs no more than the heaviest link; this decides where the motion does not.
    usual = np.sqrt(prior[0]) / _HEAVY
    found = []
    for sign in (1.0, -1.0):
        place = sign * value[1:4] / masses[0]
        place = np.append(place * min(1.0, reach / max(float(np.linalg.norm(place)), 1e-12)), _OWN * reach)
        tried = []
        for mass in sign * masses:

            def miss(c: np.ndarray, m: float = mass) -> np.ndarray:
                far = [*(2.0 * c[:3] / reach), c[3] / (_OWN * reach), usual * m]
                return np.concatenate([root @ point_parameters(m, c[:3], c[3]) - wanted, far])

            fit = optimize.least_squares(miss, place)
            place = fit.x
            tried.append((2.0 * fit.cost, mass, place))
        found.append(tried)
    # A body counts as removed only where the motion clearly tells it from an added one.
    added, removed = (min(cost for cost, _, _ in tried) for tried in found)
    chosen = found[1] if removed < added - _RISE else found[0]
    cost, mass, place = min(chosen, key=lambda one: one[0])
    ends = [m for c, m, _ in chosen if c <= cost + _RISE]
    step = 10.0 ** (0.5 / _STEPS)
    low, high = sorted(
        [mass / abs(mass) * min(map(abs, ends)) / step, mass / abs(mass) * max(map(abs, ends)) * step]
    )
    return float(mass), float(low), float(high), place[:3]
