"""One session against the reference: what changed in it, and what cannot be told."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.events import Event, find_events, leave_out, take_out_state
from wearscope.tracking.changes import FRICTION, Change
from wearscope.tracking.decision import Judged, Named, counts, excludes, name_changes, touches
from wearscope.tracking.inference import Estimate, Sample, estimate_change, make_sample
from wearscope.tracking.next_session import NextSession, plan_session, tell_plan
from wearscope.tracking.reference import Reference, choose_sample
from wearscope.tracking.rows import hold_temperatures, make_rows, stack_rows
from wearscope.tracking.scatter import Scatter, relative_change
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import prepare_runs
from wearscope.tracking.sessions import read_session
from wearscope.tracking.structure import Structure
from wearscope.tracking.worn import Worn, identify_wear

#: False-alarm rate of a session, over all joints and changes.
FALSE_ALARM_RATE = 0.01
#: Kelvin beyond the reference's temperatures that are still those of the reference.
_BEYOND = 1.0
#: A change of friction of this share must be seen, were the temperature's part known; else nothing is said.
_HIDDEN, _SEEN = 0.3, 0.15


@dataclass(frozen=True)
class Assessment:
    """What a session shows.

    Attributes
    ----------
    session : str
    named : list of Named
    estimates : dict of str to Estimate
        Every change alone, by key.
    hidden : dict of int to str
        What cannot be told of a joint's friction, and what to measure.
    notes : list of str
    worn : list of Worn
        Wear of each joint whose friction grew.
    plans : list of NextSession
        What to record next for joints of which something cannot be told.
    events : list of dict
        Short events, as ``verdict.json`` has them; their rows are left out.
    """

    session: str
    named: list[Named]
    estimates: dict[str, Estimate]
    hidden: dict[int, str]
    notes: list[str]
    worn: list[Worn]
    plans: list[NextSession] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    @property
    def cannot_tell(self) -> list[str]:
        """Sentences on what cannot be told."""
        return list(self.hidden.values())


def assess_session(
    sessions: Sessions, session: str, reference: Reference, level: float = FALSE_ALARM_RATE
) -> Assessment:
    """Read a session and say what changed since the reference.

    Raises
    ------
    InputError
        Where its runs break the format or cannot be what they say.
    """
    dataset = read_session(sessions, session)
    runs, notes = prepare_runs(dataset, reference.structure.frame)
    found = assess_runs(session, runs, reference, level, notes)
    plans = [plan_session(reference, dataset, runs, joint) for joint in found.hidden]
    kept = {plan.joint: plan for plan in plans if plan is not None}
    told = {
        joint: f"{text} {tell_plan(kept[joint])}" if joint in kept else text
        for joint, text in found.hidden.items()
    }
    return replace(found, hidden=told, plans=list(kept.values()))


def assess_runs(
    session: str,
    runs: Sequence[PreparedRun],
    reference: Reference,
    level: float = FALSE_ALARM_RATE,
    notes: Sequence[str] = (),
) -> Assessment:
    """What changed in a session's runs, prepared in the reference's frame.

    Parameters
    ----------
    session : str
    runs : sequence of PreparedRun
    reference : Reference
    level : float
        False-alarm rate of a session.
    notes : sequence of str
    """
    structure, changes, measured = reference.structure, reference.changes, reference.measured
    events = find_session_events(reference, runs)
    runs = leave_out(runs, events, structure.joints)
    made = [make_rows(structure, run) for run in runs]
    rows = stack_rows(structure, measured, made)
    sample = make_sample(rows, measured, reference.belief, reference.payload_prior)
    named = name_changes(changes, make_ask(sample, reference.scatter), level)
    held = [make_rows(structure, hold_temperatures(structure, run)) for run in runs]
    known = make_sample(
        stack_rows(structure, measured, held), measured, reference.belief, reference.payload_prior,
        structure.of_temperature,
    )  # fmt: skip
    alone = {
        change.key: estimate_alone(choose_sample(structure, change, sample, known), change, named)
        for change in measured
    }
    hidden = explain_hidden(reference, runs, sample, known, named, level)
    known_alone = {key: e for key, e in alone.items() if e is not None}
    worn = identify_wear(reference, made, named)
    told = [*notes, *tell_events(events, dict(zip(structure.joints, structure.torque_unit, strict=True)))]
    return Assessment(session, named, known_alone, hidden, told, worn, events=events)


def find_session_events(reference: Reference, runs: Sequence[PreparedRun]) -> list[Event]:
    """Short events in what the healthy machine and changes that go with the joints' states leave."""
    structure = reference.structure
    left = []
    for run in runs:
        rows = make_rows(structure, run)
        left.append(rows.target - rows.columns @ reference.belief.mean)
    frame = structure.frame
    return find_events(runs, take_out_state(runs, left), structure.joints, frame.moving, frame.top_speed)


def tell_events(events: Sequence[Event], units: dict[str, str]) -> list[str]:
    """A sentence on each event."""
    return [
        f"{e['run']}: {e['joint']}: torque that the model does not have at t = {e['t']:.2f} s for "
        f"{e['seconds']:.2f} s, up to {e['size']:.3g} {units[e['joint']]}; an event, its rows are left out."
        for e in events
    ]


def estimate_alone(sample: Sample, change: Change, named: Sequence[Named]) -> Estimate | None:
    """Estimate of a change alone; of what only has a size, given all else that the session shows."""
    given = [] if change.asked else [one.change for one in named if not excludes(one.change, change)]
    return estimate_change(sample, change, given)


def make_ask(sample: Sample, scatter: Scatter) -> Callable[[Change, Sequence[Change]], Judged | None]:
    """Estimates of changes given others in a session, each made once.

    What is no friction is asked given all that the friction of a joint may have become where it changed, so
    that what the named form leaves of it is not taken for something else.
    """
    curves = {change.joint: change for change in sample.changes if not change.asked}
    made: dict[tuple[str, ...], Judged | None] = {}

    def ask(change: Change, given: Sequence[Change]) -> Judged | None:
        key = (change.key, *sorted(c.key for c in given))
        if key not in made:
            others = given
            if not change.friction:
                others = [curves.get(c.joint, c) if c.friction else c for c in given]
            estimate = estimate_change(sample, change, others)
            made[key] = None if estimate is None else Judged(estimate, scatter.p_value(estimate))
        return made[key]

    return ask


def explain_hidden(
    reference: Reference, runs: Sequence[PreparedRun], sample: Sample, known: Sample, named: list[Named],
    level: float,
) -> dict[int, str]:  # fmt: skip
    """Sentences on friction that temperature may have changed, by joint.

    Parameters
    ----------
    reference : Reference
    runs : sequence of PreparedRun
    sample, known : Sample
        With what is known of the temperature's part; as if all of it were, and nothing changed beyond the
        reference's temperatures.
    named : list of Named
    level : float
    """
    said = {}
    ask, ask_known = make_ask(sample, reference.scatter), make_ask(known, reference.scatter)
    changes = reference.changes
    for change in changes:
        if change.name != FRICTION:
            continue
        others = [n.change for n in named]
        if any(other.friction and other.joint == change.joint for other in others):
            continue
        given = [other for other in others if touches(other, change)]
        as_known, as_is = ask_known(change, given), ask(change, given)
        if as_known is None or as_is is None:
            continue
        told = describe_temperatures(reference.structure, runs, change.joint)
        joint = reference.structure.joints[change.joint]
        share, width = relative_change(as_known.estimate, reference.scatter)
        blind = relative_change(as_is.estimate, reference.scatter)[1]
        if counts(as_known, level, len(changes)):
            size = f"{100 * share:+.0f} % ({100 * (share - width):+.0f} to {100 * (share + width):+.0f} %)"
            said[change.joint] = (
                f"The friction of {joint} changed by {size.replace('-', chr(0x2212))}, by wear or by its "
                f"temperature: {told}"
            )
        elif 2.0 * blind > _HIDDEN and 2.0 * width < _SEEN and _is_recorded(runs, change.joint):
            said[change.joint] = (
                f"A change of {joint}'s friction by less than {200 * blind:.0f} % could not be seen: {told}"
            )
    return said


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


def list_entries(named: Sequence[Named], structure: Structure, scatter: Scatter) -> list[dict[str, Any]]:
    """Entries of `tracking.json` for what a session shows, without `since`; a parameter each.

    Parameters that their interval does not tell from zero are left out where another one of the change is.
    """
    entries = []
    for one in named:
        estimate, change = one.judged.estimate, one.change
        width = scatter.width(estimate)
        sure = np.abs(estimate.value) > width
        units = structure.position_unit[change.joint], structure.torque_unit[change.joint]
        for (effect, name), value, half, told in zip(
            change.parameters, estimate.value, width, sure, strict=True
        ):
            # A load is told by its mass, however well that is known.
            if not told and sure.any() and name != "mass":
                continue
            parameter = next(p for p in effect.coefficients if p.name == name)
            entries.append(
                {
                    "joint": structure.joints[change.joint],
                    "effect": effect.name,
                    "parameter": name,
                    "change": float(value),
                    "ci95": [float(value - half), float(value + half)],
                    "unit": parameter.unit_at(*units),
                    "equivalent": list(one.equivalent),
                }
            )
    return entries
