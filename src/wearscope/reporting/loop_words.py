"""The outcome of a closed loop in words: the verdict, its effects, the joints, the next measurement."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wearscope.reporting.closed_loop import name_signal, number
from wearscope.reporting.labels import UNKNOWN, count_text, effect_name, join_words, upper_first
from wearscope.reporting.page import format_number

Verdict = Mapping[str, Any]

#: Probability of success from which on an advised measurement is worded as a promise.
PROMISED = 0.9
#: Share of the torque [%] up to which structure below the noise of a run is small.
SMALL = 1.0
#: Relative change of an error below which no sentence mentions it.
SLIGHT = 0.005
#: Noise is told at the top of the page from this share of the torque on [%].
LARGE = 10.0


#: Colour of an effect's status after the test runs.
STATUSES = {"refuted": "bad", "confirmed": "good", "not_confirmed": "unsure"}

#: Largest number of names in a headline.
_MOST_NAMES = 3
#: Beginnings of the notes on a load that the refitted masses imitate, and on loads that differ by run.
LOAD = ("The refitted masses act as a payload of ", "The load differs between runs")


def list_shared() -> set[str]:
    """Effects that the robot has once and every joint feels."""
    # Imported here: it brings compiled code, and a study without a loop does not need it.
    from wearscope.effects.vocabulary import list_effects

    return {effect.name for effect in list_effects() if effect.per_robot}


def joints_in(verdict: Verdict, state: str) -> list[str]:
    """Joints in a state."""
    return [joint for joint, one in verdict["joints"].items() if one["state"] == state]


def is_small(one: Verdict) -> bool:
    """Whether a joint's structure without a name is small: below the noise of a run, and of the torque."""
    left, structure, noise = (number(one.get(k)) for k in ("left_percent", "unexplained_rms", "noise_floor"))
    return one["state"] == "unexplained" and left <= SMALL and structure <= noise


def list_unexplained(verdict: Verdict, small: bool) -> list[str]:
    """Joints at which structure without a name is left, small or not."""
    return [j for j in joints_in(verdict, "unexplained") if is_small(verdict["joints"][j]) == small]


def tell_unexplained(verdict: Verdict, small: bool) -> str:
    """Sentence part on the joints with unexplained structure, size first; empty without such joints."""
    joints = list_unexplained(verdict, small)
    if not joints:
        return ""
    who = join_words(joints) if len(joints) < 4 else f"{len(joints)} of {len(verdict['joints'])} joints"
    shares = [number(verdict["joints"][joint].get("left_percent")) for joint in joints]
    most = "at most " if len(joints) > 1 else ""
    size = f"{most}{format_number(max(shares), 2)} % of the torque" if np.isfinite(shares).all() else ""
    if not size:
        return f"{who} {'keeps' if len(joints) == 1 else 'keep'} something unexplained"
    tail = "and its structure lies below the noise of a run" if small else "part of it unexplained"
    return f"{size} is left at {who}, {tail}"


def tell_noise(verdict: Verdict) -> str:
    """Joints whose remaining error is plain noise but a large share of the torque; empty without any."""
    shares = {
        joint: number(one.get("left_percent"))
        for joint, one in verdict["joints"].items()
        if one["state"] in ("explained", "corrected") and number(one.get("left_percent")) > LARGE
    }
    if not shares:
        return ""
    most = "at most " if len(shares) > 1 else ""
    size = f"{most}{format_number(max(shares.values()), 2)} % of the torque"
    return f"{size} is left at {join_words(list(shares))}, as noise"


def name_with_rivals(entry: Verdict) -> str:
    """An effect with its equivalents and their place: a joint, the robot, or one for each name."""
    names = (entry["effect"], *entry["equivalent"])
    places = ["of the robot" if name in list_shared() else f"at {entry['joint']}" for name in names]
    if len(set(places)) == 1:
        return f"{join_words([*map(effect_name, names)], 'or')} {places[0]}"
    told = [f"{effect_name(name)} {place}" for name, place in zip(names, places, strict=True)]
    return join_words(told, "or")


def conclude_loop(verdict: Verdict) -> tuple[str, str]:
    """The outcome in one plain sentence, and its colour: good, unsure or bad."""
    held = [
        one
        for one in verdict["verdict"]
        if one["status"] != "refuted" and (one["effect"] != UNKNOWN or is_in_model(one))
    ]
    left, unjudged = tell_unexplained(verdict, small=False), joints_in(verdict, "not_judged")
    said = [left] if left else []
    said += [f"{join_words(unjudged)} {'is' if len(unjudged) == 1 else 'are'} not judged"] if unjudged else []
    rest, load = join_words(said), tell_load(verdict)
    nothing = "Nothing else that the" if load else "Nothing that the"
    if not held and (said or load or doubt_masses(verdict)):
        rest = rest or tell_unexplained(verdict, small=True) or tell_noise(verdict)
        rest = f", and {rest}" if rest else ""
        if left and not load:
            return "bad", f"No effect that the test runs bear out was named{rest}."
        masses = "" if said or load else " once its masses are refitted"
        return "unsure", f"{load}{nothing} declared model lacks is seen{masses}{rest}."
    if not held:
        if small := tell_unexplained(verdict, small=True):
            return "good", f"The declared model suffices within the noise of a run: {small}."
        if noise := tell_noise(verdict):
            return "unsure", f"Nothing that the declared model lacks is seen, but {noise}."
        return "good", "The declared model suffices: nothing that it lacks is seen on these runs."
    groups: dict[tuple[str, str, bool], list[Verdict]] = {}
    common = verdict.get("time_delay") or {"joints": []}
    seen = any(one["status"] == "confirmed" for one in held if one["effect"] == common.get("effect"))
    for one in held:
        alone = not list_shared().intersection((one["effect"], *one["equivalent"]))
        told = effect_name(one["effect"]) if alone else name_with_rivals(one)
        told = "a torque without a name" if one["effect"] == UNKNOWN else told
        kept, sure = is_in_model(one), one["status"] == "confirmed"
        if one["joint"] in common["joints"] and one["effect"] == common.get("effect"):
            told, sure = f"one delay of the recorder ({1e3 * common['seconds']:.3g} ms)", seen
        doubts = "" if sure else " (not confirmed)"
        doubts += "" if kept else " (left out of the corrected model)"
        groups.setdefault((told, doubts, kept), []).append(one)
    every = [f"{_tell_group(verdict, told, own)}{doubts}" for (told, doubts, _), own in groups.items()]
    more_names = [f"and {len(every) - _MOST_NAMES} more"] if len(every) > _MOST_NAMES else []
    lacks = "; ".join([*every[:_MOST_NAMES], *more_names])
    gain = _tell_gain(verdict, [kept for *_, kept in groups])
    text = f"{load}The declared model {'also ' if load else ''}lacks {lacks}. {gain}"
    grown = _tell_growth(verdict)
    certain = [
        one["status"] == "confirmed" and is_in_model(one) and not one["equivalent"]
        for one in held
        if one["effect"] != UNKNOWN
    ]
    more = [upper_first(one) for one in (rest, tell_noise(verdict)) if one]
    sure = len(certain) == len(held) and all(certain) and not grown and not more and not load
    return "good" if sure else "unsure", ". ".join([f"{text}{grown}", *more]) + "."


def _tell_group(verdict: Verdict, told: str, entries: Sequence[Verdict]) -> str:
    """Name of an effect with its joints, and with its rivals where these are the same at each joint."""
    if list_shared().intersection(name for one in entries for name in (one["effect"], *one["equivalent"])):
        return told
    rivals = {tuple(map(effect_name, one["equivalent"])) for one in entries}
    where = _tell_where(verdict, [one["joint"] for one in entries])
    if len(rivals) == 1:
        return f"{join_words([told, *rivals.pop()], 'or')}{where}"
    open_at = {one["joint"] for one in entries if one["equivalent"]}
    return f"{told}{where} (at {len(open_at)} of them other names fit as well)"


def tell_rivals(verdict: Verdict) -> str:
    """Names that these runs do not tell apart, and their joints; empty without any."""
    found: dict[tuple[str, ...], list[Verdict]] = {}
    for one in verdict["verdict"]:
        if one["equivalent"]:
            found.setdefault((one["effect"], *one["equivalent"]), []).append(one)
    shared = list_shared()
    told = [
        name_with_rivals(own[0]) if shared & {*names} else _tell_group(verdict, effect_name(names[0]), own)
        for names, own in found.items()
    ]
    return f"These runs leave open whether it is {'; '.join(told)}." if told else ""


def tell_load(verdict: Verdict) -> str:
    """Sentence on loads by run or in the place of refitted masses, with a space; empty without any."""
    known = [note.partition(":")[0] for note in verdict.get("notes", []) if note.startswith(LOAD)]
    return f"{known[0]}. " if known else ""


def doubt_masses(verdict: Verdict) -> str:
    """Doubts about the URDF or the torques' size by the refitted masses; empty without any."""
    shared = [one for one in verdict["verdict"] if one["effect"] in list_shared()]
    if any(one["status"] == "confirmed" and is_in_model(one) for one in shared):
        return ""  # the body's error has a name
    if factors := verdict.get("torque_factors"):
        low, high = min(factors.values()), max(factors.values())
        size = format_number(low) if high < 1.05 * low else f"{format_number(low)} to {format_number(high)}"
        where = "" if len(factors) == len(verdict["joints"]) else f" at {join_words(list(factors))}"
        told = (
            "the payload, masses, torque constants or positions' scale are off, or a balancer is undeclared"
        )
        return f"Torques{where} are {size} times what the URDF's masses need: {told}."
    if far := verdict.get("far_links"):
        told = "a load is undeclared, or the URDF is wrong"
        return f"Masses were refitted far from the URDF at {join_words(far)}: {told}."
    return ""


def _tell_where(verdict: Verdict, joints: Sequence[str]) -> str:
    """The joints of an effect."""
    every, joints = list(verdict["joints"]), list(dict.fromkeys(joints))
    if len(joints) == len(every) > 2:
        return f" at all {len(every)} joints"
    return f" at {join_words(sorted(joints, key=every.index))}"


def _changes(verdict: Verdict) -> list[tuple[float, str, float, float, str]]:
    """Ratio of the errors, joint, error before, error after, unit, for joints that move on the test runs."""
    found = []
    for joint, one in verdict["joints"].items():
        before, after = number(one.get("rms_before")), number(one.get("rms_after"))
        if np.isfinite([before, after]).all() and before > 0:
            found.append((after / before, joint, before, after, one["unit"]))
    return found


def falls_anywhere(verdict: Verdict) -> bool:
    """Whether a joint's error on the test runs falls by more than half a percent."""
    return any(ratio <= 1.0 - SLIGHT for ratio, *_ in _changes(verdict))


def _tell_growth(verdict: Verdict) -> str:
    """Where the error on the test runs grows; empty where it does not."""
    larger = {joint for joint, one in verdict["joints"].items() if one.get("error") == "larger"}
    worse = [one for one in _changes(verdict) if one[1] in larger and one[0] > 1.0 + SLIGHT]
    if not worse:
        return ""
    ratio, joint, *_ = max(worse)
    others = len(worse) - 1
    also = f" (and at {count_text(others, 'other joint')} by less)" if others else ""
    return f", but grows by {100 * (ratio - 1):.0f} % at {joint}{also}"


def is_in_model(entry: Verdict) -> bool:
    """Whether the corrected model has an effect."""
    return bool(entry.get("in_model", entry["status"] != "refuted"))


def _tell_gain(verdict: Verdict, kept: Sequence[bool]) -> str:
    """Joint where the error on the test runs falls most with the effects that are kept."""
    found = _changes(verdict)
    if not found:
        return "No joint moves on the test runs, so the correction is not judged"
    ratio, joint, before, after, unit = min(found)
    if not falls_anywhere(verdict):
        return "On the test runs no joint's error falls by more than half a percent"
    with_it = "With it" if sum(kept) == 1 else "With them"
    if not any(kept):
        with_it = "Without it" if len(kept) == 1 else "Without them"
    elif not all(kept):
        with_it = "With the others" if sum(kept) > 1 else "With the other one"
    return (
        f"{with_it}, the error on the test runs falls by up to {100 * (1 - ratio):.0f} %, at {joint} from "
        f"{format_number(before)} to {format_number(after)} {unit}"
    )


def list_alarms(verdict: Verdict) -> list[tuple[str, str]]:
    """Simulations that failed: alarm, and its text."""
    said = []
    for stage in ("before", "after"):
        outcomes = {one[stage]["outcome"] for one in verdict.get("forward", {}).values()} - {"ok"}
        said += [("alarm", f"Simulated forward, model {stage}: {text}") for text in sorted(outcomes)]
    return said


def say_share(entry: Verdict) -> str:
    """Share of the residual variance that an effect removes on the test runs, with its 95 % interval."""
    share = number(entry["error_reduction"])
    low, high = (number(value) for value in entry["error_reduction_ci95"])
    if not np.isfinite(share):
        return "it removes an unknown share of the residual variance"
    if share < 0.0:
        return f"it adds {_percent(-share, -high, -low)} to the residual variance"
    return f"it removes {_percent(share, low, high)} of the residual variance"


def _percent(share: float, low: float, high: float) -> str:
    """``48 % (95 %: 36 to 55)``, with a digit more near none and all."""
    digits = 0 if 0.095 <= abs(share) < 0.995 else 1
    share, low, high = (round(100 * value, digits) + 0.0 for value in (share, low, high))
    text = f"{share:.{digits}f} % (95 %: {low:.{digits}f} to {high:.{digits}f})"
    return text.replace("-", "\N{MINUS SIGN}").replace("nan", "n/a")


def tell_planted(verdict: Verdict, planted: Verdict) -> str:
    """Whether the verdict is what was planted in the simulated machine."""
    entries, wanted = verdict["verdict"], planted.get("planted", [])
    if not wanted:
        return "Nothing was planted: " + ("so it should be." if not entries else "a false alarm.")
    parts, right = [], []
    for one in wanted:
        accepted = set(one.get("accepted") or [one["effect"]])
        hits = [
            entry
            for entry in entries
            if entry["joint"] == one["joint"] and accepted & {entry["effect"], *entry.get("equivalent", [])}
        ]
        right += hits
        found = "found" if hits else "did not find"
        parts.append(f"{effect_name(one['effect'])} at {one['joint']}, which the loop {found}")
    wrong = [f"{effect_name(entry['effect'])} at {entry['joint']}" for entry in entries if entry not in right]
    tail = f" It named what was not planted: {join_words(wrong)}." if wrong else ""
    return f"Planted was {join_words(parts)}.{tail}"


def tell_sizes(one: Verdict) -> str:
    """A joint's error before and after."""
    before, after, floor = (number(one.get(key)) for key in ("rms_before", "rms_after", "noise_floor"))
    if not np.isfinite([before, after]).all():
        return "the joint does not move on the test runs"
    told = f"{format_number(before)} → " if abs(after - before) > 1e-6 * before else ""
    noise = f", noise floor {format_number(floor)}" if floor == floor else ""
    return f"{told}{format_number(after)} {one['unit']} RMS{noise}"


def tell_left(one: Verdict) -> str:
    """Size and evidence of unexplained structure; without any, what was not judged or is uncertain."""
    if one["state"] == "unexplained":
        if not one["depends_on"] and one["reason"].startswith("the test runs' error"):
            return upper_first(one["reason"])  # there, its size is the error itself
        noise = ", below the noise of a run" if is_small(one) else ""
        size = f"{format_number(number(one['unexplained_rms']))} {one['unit']} RMS of it{noise}"
        if one["depends_on"]:
            return f"{size}{',' if noise else ''} {tell_why(one).removeprefix('it ')}"
        return f"{size}: {tell_why(one)}"
    return str(one["reason"])


def tell_why(one: Verdict) -> str:
    """Evidence of unexplained structure; where the reason has codes of signals, their names instead."""
    if one["reason"].startswith("training runs contradict"):
        return str(one["reason"])  # which is why it seems to depend on a signal
    if on := join_words([*map(name_signal, one["depends_on"])]):
        return f"it depends on {on}"
    return one["reason"] or "it depends on no known signal"


def size_left(one: Verdict) -> str:
    """Unexplained part of a joint's torque in per cent; empty where it is not known."""
    share = number(one.get("left_percent"))
    return f"{format_number(share, 2)} % of the torque" if np.isfinite(share) else ""


def tell_measurement(entry: Verdict) -> str:
    """Advice on what to record next in a sentence or two."""
    first, *others = map(effect_name, entry["names"])
    rivals, runs = join_words(others, "or"), count_text(entry["runs"], "run")
    power = "more than 0.99" if entry["power"] > 0.99 else format_number(entry["power"], 2)
    if entry["power"] < PROMISED:
        return (
            f"None of the {entry['plans_compared']} motions that were compared separates {first} from "
            f"{rivals} for sure. The best one does with probability {power}, after {runs}."
        )
    payload, warm = entry["payload"], entry["start_temperature"]
    carried = "without a payload" if payload is None else f"with {format_number(payload['mass'])} kg"
    start = "" if warm is None else f", started at {format_number(warm)} °C"
    where = entry.get("table") or entry.get("cycle_file") or f"test-cycle {entry['cycle']}"
    return (
        f"Record {where} ({format_number(entry['seconds'])} s, {carried}{start}), {runs}. "
        f"It separates {first} from {rivals} with probability {power}."
    )
