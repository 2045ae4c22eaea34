"""The outcome of a closed loop in words: the verdict, its effects, the joints, the next measurement."""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from wearscope.reporting.closed_loop import name_signal, number
from wearscope.reporting.labels import UNKNOWN, effect_name, join_words
from wearscope.reporting.page import format_number, say

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
#: How notes on the load begin: refitted masses, and payloads that differ between runs.
LOAD = ("The refitted masses ", "The load differs between runs")


def _say(macro: str, *given: Any) -> str:
    """Sentences of a macro of this module's template, as plain text."""
    return say("loop/words.html", macro, *given).striptags()


def list_shared() -> set[str]:
    """Names of effects of the whole robot, such as a payload, which act on every joint."""
    # Imported here: it brings compiled code, and a study without a loop does not need it.
    from wearscope.effects.vocabulary import list_effects

    return {effect.name for effect in list_effects() if effect.per_robot}


def joints_in(verdict: Verdict, state: str) -> list[str]:
    """Joints in a state."""
    return [joint for joint, one in verdict["joints"].items() if one["state"] == state]


def is_small(one: Verdict) -> bool:
    """Whether a joint's unexplained structure is at most `SMALL` % of the torque and the noise of a run."""
    left, structure, noise = (number(one.get(k)) for k in ("left_percent", "unexplained_rms", "noise_floor"))
    return one["state"] == "unexplained" and left <= SMALL and structure <= noise


def list_unexplained(verdict: Verdict, small: bool) -> list[str]:
    """Joints with unexplained structure that is small (`small`), or those where it is not."""
    return [j for j in joints_in(verdict, "unexplained") if is_small(verdict["joints"][j]) == small]


def tell_unexplained(verdict: Verdict, small: bool) -> str:
    """Sentence part on the joints with unexplained structure, size first; empty without such joints."""
    joints = list_unexplained(verdict, small)
    shares = [number(verdict["joints"][joint].get("left_percent")) for joint in joints]
    size = format_number(max(shares), 2) if joints and np.isfinite(shares).all() else ""
    return _say("unexplained", joints, len(verdict["joints"]), size, small)


def tell_noise(verdict: Verdict) -> str:
    """Joints whose remaining error is plain noise but a large share of the torque; empty without any."""
    shares = {
        joint: number(one.get("left_percent"))
        for joint, one in verdict["joints"].items()
        if one["state"] in ("explained", "corrected") and number(one.get("left_percent")) > LARGE
    }
    return _say("noise", list(shares), format_number(max(shares.values(), default=0.0), 2))


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
    left, load, noise = tell_unexplained(verdict, small=False), tell_load(verdict), tell_noise(verdict)
    small = tell_unexplained(verdict, small=True)
    rest = join_words([*filter(None, [left, _say("unjudged", joints_in(verdict, "not_judged"))])])
    told = SimpleNamespace(left=left, load=load, noise=noise, small=small, rest=rest)
    if not held:
        told.doubted = bool(rest or load or doubt_masses(verdict))
        sure = not told.doubted and (small or not noise)
        return "bad" if left and not load else "good" if sure else "unsure", _say("nothing", told)
    groups: dict[tuple[str, str, bool], list[Verdict]] = {}
    common = verdict.get("time_delay") or {"joints": []}
    seen = any(one["status"] == "confirmed" for one in held if one["effect"] == common.get("effect"))
    for one in held:
        alone = not list_shared().intersection((one["effect"], *one["equivalent"]))
        name = effect_name(one["effect"]) if alone else name_with_rivals(one)
        name = "a torque without a name" if one["effect"] == UNKNOWN else name
        kept, sure = is_in_model(one), one["status"] == "confirmed"
        if one["joint"] in common["joints"] and one["effect"] == common.get("effect"):
            name, sure = f"one delay of the recorder ({1e3 * common['seconds']:.3g} ms)", seen
        states = (("not confirmed", sure), ("left out of the corrected model", kept))
        doubts = ", ".join(doubt for doubt, fine in states if not fine)
        groups.setdefault((name, f" ({doubts})" if doubts else "", kept), []).append(one)
    every = [f"{_tell_group(verdict, name, own)}{doubts}" for (name, doubts, _), own in groups.items()]
    changes = _changes(verdict)
    gain = _say("gain", changes, falls_anywhere(verdict), [kept for *_, kept in groups])
    growth = _say("growth", [one for one in changes if one.larger and one.ratio > 1.0 + SLIGHT])
    certain = all(
        one["effect"] != UNKNOWN
        and one["status"] == "confirmed"
        and is_in_model(one)
        and not one["equivalent"]
        for one in held
    )
    kind = "good" if certain and not (growth or rest or noise or load) else "unsure"
    return kind, _say("lacks", told, every, _MOST_NAMES, gain, growth)


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
    """Sentence on loads that differ by run, or on refitted masses; empty without."""
    known = [note.partition(":")[0] for note in verdict.get("notes", []) if note.startswith(LOAD)]
    return f"{known[0]}." if known else ""


def doubt_masses(verdict: Verdict) -> str:
    """Sentence that the refitted masses make the URDF or the torques' scale doubtful; empty if not."""
    shared = [one for one in verdict["verdict"] if one["effect"] in list_shared()]
    if any(one["status"] == "confirmed" and is_in_model(one) for one in shared):
        return ""  # a named effect, such as a payload, explains the refitted masses
    if factors := verdict.get("torque_factors"):
        low, high = min(factors.values()), max(factors.values())
        sizes = [low] if high < 1.05 * low else [low, high]
        joints = [] if len(factors) == len(verdict["joints"]) else list(factors)
        return _say("torques", [format_number(size) for size in sizes], joints)
    return _say("masses", verdict.get("far_links") or [])


def _tell_where(verdict: Verdict, joints: Sequence[str]) -> str:
    """Sentence part with the joints of an effect: 'at all 6 joints', or their names."""
    every, joints = list(verdict["joints"]), list(dict.fromkeys(joints))
    if len(joints) == len(every) > 2:
        return f" at all {len(every)} joints"
    return f" at {join_words(sorted(joints, key=every.index))}"


def _changes(verdict: Verdict) -> list[SimpleNamespace]:
    """Errors before and after at the joints that move on the test runs; the largest fall first."""
    found = []
    for joint, one in verdict["joints"].items():
        before, after = number(one.get("rms_before")), number(one.get("rms_after"))
        if np.isfinite([before, after]).all() and before > 0:
            sizes = {"ratio": after / before, "before": before, "after": after, "unit": one["unit"]}
            found.append(SimpleNamespace(joint=joint, larger=one.get("error") == "larger", **sizes))
    return sorted(found, key=lambda one: (one.ratio, one.joint))


def falls_anywhere(verdict: Verdict) -> bool:
    """Whether a joint's error on the test runs falls by more than half a percent."""
    return any(one.ratio <= 1.0 - SLIGHT for one in _changes(verdict))


def is_in_model(entry: Verdict) -> bool:
    """Whether the corrected model has an effect."""
    return bool(entry.get("in_model", entry["status"] != "refuted"))


def list_alarms(verdict: Verdict) -> list[tuple[str, str]]:
    """Failed simulations as pairs of ``alarm`` and a text."""
    forward = verdict.get("forward", {}).values()
    return [
        ("alarm", f"Simulated forward, model {stage}: {text}")
        for stage in ("before", "after")
        for text in sorted({one[stage]["outcome"] for one in forward} - {"ok"})
    ]


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
    """``48 % (95 %: 36 to 55)``, with one more digit near 0 and 100 %."""
    digits = int(abs(share) < 0.095 or 0.995 <= abs(share) <= 1.0)
    share, low, high = (round(100 * value, digits) + 0.0 for value in (share, low, high))
    text = f"{share:.{digits}f} % (95 %: {low:.{digits}f} to {high:.{digits}f})"
    return text.replace("-", "\N{MINUS SIGN}").replace("nan", "n/a")


def tell_planted(verdict: Verdict, planted: Verdict) -> str:
    """Whether the verdict is what was planted in the simulated machine."""
    entries, parts, right = verdict["verdict"], [], []
    for one in planted.get("planted", []):
        accepted = set(one.get("accepted") or [one["effect"]])
        hits = [
            entry
            for entry in entries
            if entry["joint"] == one["joint"] and accepted & {entry["effect"], *entry.get("equivalent", [])}
        ]
        right += hits
        parts.append(f"{effect_name(one['effect'])} at {one['joint']} ({'' if hits else 'not '}found)")
    wrong = [f"{effect_name(entry['effect'])} at {entry['joint']}" for entry in entries if entry not in right]
    return _say("planted", parts, wrong)


def tell_sizes(one: Verdict) -> str:
    """A joint's error before and after."""
    before, after, floor = (number(one.get(key)) for key in ("rms_before", "rms_after", "noise_floor"))
    changed = abs(after - before) > 1e-6 * before
    first, last, noise = map(format_number, (before, after, floor))
    first = first if changed else ""
    return _say("sizes", np.isfinite([before, after]).all(), first, last, one["unit"], noise)


def tell_left(one: Verdict) -> str:
    """Size and evidence of unexplained structure; without any, what was not judged or is uncertain."""
    size = format_number(number(one.get("unexplained_rms")))
    why = tell_why(one) if one["state"] == "unexplained" else ""
    return _say("left", one, size, is_small(one), why)


def tell_why(one: Verdict) -> str:
    """Evidence of unexplained structure; where the reason has codes of signals, their names instead."""
    if one["reason"].startswith("training runs contradict"):
        return str(one["reason"])  # the contradiction makes it seem to depend on signals
    if on := join_words([*map(name_signal, one["depends_on"])]):
        return f"it depends on {on}"
    return one["reason"] or "it depends on no known signal"


def size_left(one: Verdict) -> str:
    """Unexplained part of a joint's torque in per cent; empty where it is not known."""
    share = number(one.get("left_percent"))
    return f"{format_number(share, 2)} % of the torque" if np.isfinite(share) else ""


def tell_measurement(entry: Verdict) -> str:
    """Advice on what to record next in a sentence or two."""
    return _say("measurement", entry, [effect_name(name) for name in entry["names"]], PROMISED)
